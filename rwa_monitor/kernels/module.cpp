// The extension module: one submodule for each stage, in the order of the data, importable as rwa_monitor.kernels.STAGE.
#include <nanobind/nanobind.h>

#include <string>

#define STAGES(DO)        \
    DO(effects)           \
    DO(torque_balance)    \
    DO(ingest)            \
    DO(running_sums)      \
    DO(wglr)              \
    DO(noise)             \
    DO(evidence)          \
    DO(changepoints)      \
    DO(segmentation)      \
    DO(laws)              \
    DO(friction)          \
    DO(assignment)        \
    DO(chain_decoding)    \
    DO(state_space)

namespace rwa {
#define DECLARE(stage) void bind_##stage(nanobind::module_&);
STAGES(DECLARE)
}  // namespace rwa

NB_MODULE(_kernels, module) {
    nanobind::set_leak_warnings(false);  // the interpreter frees modules in any order when it ends
    nanobind::dict modules = nanobind::module_::import_("sys").attr("modules");
#define BIND(stage)                                                      \
    {                                                                    \
        auto part = module.def_submodule(#stage);                        \
        rwa::bind_##stage(part);                                         \
        modules["rwa_monitor.kernels." #stage] = part;                   \
    }
    STAGES(BIND)
}
