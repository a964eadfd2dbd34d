"""The friction model as an FMU (FMI 3.0): model exchange and co-simulation, with sources and a binary for Linux.

Layout, schemas and functions: Functional Mock-up Interface Specification 3.0, Modelica Association, 2022.
"""

from __future__ import annotations

import io
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from hashlib import sha256
from pathlib import Path
from typing import Final

from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.export.c_source import c_files, render
from rwa_monitor.export.model import INPUTS, FrictionModel
from rwa_monitor.wheel.effects.viscosity_temperature import ORIGIN_degC

# No contraction to fused multiply-add: the bits of the package's own kernels.
FLAGS: Final = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared")


def fmu_files(model: FrictionModel) -> dict[str, bytes]:
    """Return the FMU by the name of its file: the same model gives the same bytes with the same compiler.

    Raises
    ------
    InputError
        If there is no C compiler.
    RwaMonitorError
        If it fails.
    """
    sources = c_files(model)
    token = sha256("".join(sources.values()).encode()).hexdigest()
    sources["rwa_fmi3.c"] = render("rwa_fmi3.c", model, token=token, temperature=ORIGIN_degC)
    description = render("modelDescription.xml", model, token=token, temperature=ORIGIN_degC, inputs=INPUTS)
    contents = {
        "modelDescription.xml": description.encode(),
        f"binaries/{platform.machine()}-linux/rwa_friction.so": shared_library(sources, "--to fmu"),
        "sources/buildDescription.xml": render("buildDescription.xml", model).encode(),
        **{f"sources/{name}": text.encode() for name, text in sources.items()},
    }
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)  # dated 1980, whenever written
    return {"rwa_friction.fmu": file.getvalue()}


def shared_library(sources: dict[str, str], place: str, hidden: bool = True) -> bytes:
    """Compile C sources with the system's compiler, or that of the environment's CC; errors as in `fmu_files`.

    Where `hidden`, only functions that ask for it are seen from outside: two FMUs in one process do not mix.
    """
    compiler = shlex.split(os.environ.get("CC", "cc"))
    if sys.platform != "linux":
        raise InputError(place, "writes a binary for Linux; --to c gives the source, for any system")
    if not compiler or shutil.which(compiler[0]) is None:
        raise InputError(place, "needs a C compiler (cc, or $CC): apt-get install gcc; --to c needs none")
    with tempfile.TemporaryDirectory() as folder:
        for name, text in sources.items():
            Path(folder, name).write_text(text, encoding="utf-8")
        units = [name for name in sources if name.endswith(".c")]
        visibility = ["-fvisibility=hidden"] if hidden else []
        command = [*compiler, *FLAGS, *visibility, *units, "-lm", "-o", "model.so"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603 - $CC is the user's
        if done.returncode != 0:
            raise RwaMonitorError(f"{place}: {compiler[0]} fails: {done.stderr.strip()[:500]}")
        return Path(folder, "model.so").read_bytes()
