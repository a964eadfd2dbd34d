"""The compiled loops: C++ with one file for each stage.

Arrays in, arrays out; no clock, file or network. A stage NAME is imported as `rwa_monitor.kernels.NAME`; types and
units are documented in NAME.pyi. `CMakeLists.txt` builds them when the package is installed.
"""

import rwa_monitor.kernels._kernels  # noqa: F401
