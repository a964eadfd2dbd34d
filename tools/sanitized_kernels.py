"""Plug-in of pytest: the tests take the kernels of `make sanitize` (RWA_KERNELS) in place of the installed ones."""

import importlib.util
import os
import sys

NAME = "rwa_monitor.kernels._kernels"

_spec = importlib.util.spec_from_file_location(NAME, os.environ["RWA_KERNELS"])
assert _spec is not None
assert _spec.loader is not None
sys.modules[NAME] = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(sys.modules[NAME])
