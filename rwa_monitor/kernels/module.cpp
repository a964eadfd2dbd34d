// The extension module: one submodule for each stage, importable as rwa_monitor.kernels.STAGE.
#include "arrays.hpp"

NB_MODULE(_kernels, module) {
    nanobind::set_leak_warnings(false);  // the interpreter frees modules in any order when it ends
    nanobind::dict modules = nanobind::module_::import_("sys").attr("modules");
    for (const auto& [name, bind] : rwa::stages) {
        auto part = module.def_submodule(name.c_str());
        bind(part);
        modules[("rwa_monitor.kernels." + name).c_str()] = part;
    }
}
