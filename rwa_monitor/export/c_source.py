"""C code: the friction model, alone or in an FMU, and the settings of the onboard detector.

The model is one C99 file and its header, without allocation, with libm only; the header states the error due to each
effect that is left out. The FMU has sources and a binary for Linux, for model exchange and co-simulation. Layout,
schemas and functions: Functional Mock-up Interface Specification 3.0, Modelica Association, 2022. The settings are of
`kernels/onboard/rwa_detector.h`.
"""

import io
import math
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import jinja2
import numpy as np

from rwa_monitor.changepoints.evidence import TAIL_FACTOR, WindowAccumulator
from rwa_monitor.changepoints.noise import TAIL_RATIO, largest_outlier, outlier_chance
from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.export.model import INPUTS, FrictionModel, Part, literal
from rwa_monitor.kernels.noise import CHI_MEDIAN
from rwa_monitor.samples import FloatArray
from rwa_monitor.simulation.motion import wheel_angle
from rwa_monitor.simulation.record import COUPLING_ROUNDS, ORBITAL_SWING_K, couple
from rwa_monitor.wheel.effects.base import Channels, Effect, MeanEffect, NoiseEffect
from rwa_monitor.wheel.effects.catalogue import viscous_effects
from rwa_monitor.wheel.effects.drag_laws import ORIGIN_degC
from rwa_monitor.words import SOFTWARE

SLOTS: Final = 20_001  # of a sweep
SWEEP_S: Final = 2_000.0  # s, from rest to the largest speed, down to the opposite one, and back to rest


def sweep(model: FrictionModel, top_rad_s: float) -> Channels:
    """Return a motion from rest to a speed, to its opposite and back, at constant acceleration, with 15 to 25 °C."""
    time, period_s = np.linspace(0.0, SWEEP_S, SLOTS), SWEEP_S / (SLOTS - 1)
    speed = np.interp(time, SWEEP_S * np.array([0.0, 0.25, 0.75, 1.0]), top_rad_s * np.array([0.0, 1.0, -1.0, 0.0]))
    rate = np.where(np.abs(time - 0.5 * SWEEP_S) < 0.25 * SWEEP_S, -1.0, 1.0) * 4.0 * top_rad_s / SWEEP_S
    level = np.full(SLOTS, model.nominal.dry_torque_Nm)
    inertia = model.wheel.inertia_kg_m2
    return Channels(
        time_s=time,
        speed_rad_s=speed,
        direction=np.sign(speed),
        acceleration_rad_s2=rate,
        angle_rad=wheel_angle(speed, period_s),
        motor_torque_Nm=None if inertia is None else inertia * rate + base_law(model, speed),
        bearing_temperature_degC=ORIGIN_degC + ORBITAL_SWING_K[-1] * np.sin(2.0 * np.pi * time / SWEEP_S),
        dry_level_Nm=level,
        sample_period_s=period_s,
        good=np.ones(SLOTS, dtype=np.bool_),
    )


def base_law(model: FrictionModel, speed_rad_s: FloatArray) -> FloatArray:
    """Return nominal dry and viscous friction, without jumps and effects [N m]."""
    return np.sign(speed_rad_s) * model.nominal.dry_torque_Nm + model.nominal.viscous_Nm_s_rad * speed_rad_s


def torque(model: FrictionModel, effects: Sequence[Effect], channels: Channels) -> FloatArray:
    """Return the friction with some effects, as in the simulation, without jumps [N m]."""
    coupled = couple([effect for effect in effects if isinstance(effect, MeanEffect)], channels)
    return sum(coupled.values(), start=base_law(model, channels.speed_rad_s))


def rms(values: FloatArray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def cost(part: Part, model: FrictionModel) -> str:
    """Return in words the error of a model without an effect, over a sweep to the nominal speed."""
    top = model.nominal.nominal_speed_rad_s
    over = f"over a sweep to {top:g} rad/s in {SWEEP_S / 4:g} s"
    channels = sweep(model, top)
    if isinstance(part.effect, MeanEffect):
        if channels.motor_torque_Nm is None:
            return "not known without inertia_kg_m2"
        return f"an RMSE of {rms(part.effect.torque(channels)[0]):.2g} N m {over}"
    if isinstance(part.effect, NoiseEffect):
        std = model.wheel.noise.friction_std_Nm or 0.0
        white = std * np.random.default_rng(0).standard_normal(SLOTS)
        noise = part.effect.apply(white, channels, np.random.default_rng(1))
        return f"a scatter of {rms(noise):.2g} N m {over}, beside {std:.2g} N m of white noise without it"
    return "nothing, where the caller's level jumps as the effect has it"


# ---- the model in C --------------------------------------------------------------------------------------------------


FOLDER: Final = Path(__file__).parent
RECURSIONS: Final = FOLDER.parent / "kernels" / "recursions.h"
PLAIN: Final = str.maketrans({"±": "+-", "²": "2", "°": "deg", "·": " ", "−": "-", "ω": "w"})


def comment(text: str) -> str:
    """Return a text in ASCII that cannot end a comment in C: no content of a file becomes code."""
    text = " ".join(text.translate(PLAIN).encode("ascii", "replace").decode().split())
    return re.sub(r"(?<=\?)(?=\?)", " ", text.replace("*/", "* /").replace("/*", "/ *"))


def error(std: float | None) -> str:
    """Return a standard deviation in words."""
    return "not known" if std is None else f"{std:.2g}"


def recursions(model: FrictionModel) -> str:
    """Return the functions of the kernels' header that the model calls."""
    parts = re.split(r"/\* -{4} (\w+) -+ \*/\n", RECURSIONS.read_text(encoding="utf-8"))
    return "".join(
        text for name, text in zip(parts[1::2], parts[2::2], strict=True) if name == "rwa_sign" or model.uses(name)
    )


def render(template: str, model: FrictionModel, **more: Any) -> bytes:
    """Render a template of this package for a model; return the content of the file."""
    environment = jinja2.Environment(  # noqa: S701 - C is no HTML; XML escapes by the filter
        loader=jinja2.FileSystemLoader(FOLDER),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {"c": literal, "comment": comment, "error": error}
    environment.globals["cost"] = cost
    known = {"model": model, "wheel": model.wheel, "software": SOFTWARE}
    return environment.get_template(f"{template}.jinja").render(**known, **more).encode()


def c_files(model: FrictionModel) -> dict[str, bytes]:
    """Return header and source by file name."""
    return {
        "rwa_friction.h": render("rwa_friction.h", model),
        "rwa_friction.c": render(
            "rwa_friction.c",
            model,
            recursions=recursions(model),
            free=[part for part in model.parts if not part.coupled],
            coupled=[part for part in model.parts if part.coupled],
            rounds=COUPLING_ROUNDS,
        ),
    }


# ---- the model as an FMU ---------------------------------------------------------------------------------------------


# No contraction to fused multiply-add, so that results equal those of the package's kernels to the bit.
FLAGS: Final = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared")


def fmu_files(model: FrictionModel) -> dict[str, bytes]:
    """Return the FMU by file name; the same model and compiler give the same bytes.

    Raises
    ------
    InputError
        If the system is not Linux, or there is no C compiler.
    RwaMonitorError
        If the compiler fails.
    """
    sources = c_files(model)
    token = sha256(b"".join(sources.values())).hexdigest()
    sources["rwa_fmi3.c"] = render("rwa_fmi3.c", model, token=token, temperature=ORIGIN_degC)
    contents = {
        "modelDescription.xml": render(
            "modelDescription.xml", model, token=token, temperature=ORIGIN_degC, inputs=INPUTS
        ),
        f"binaries/{platform.machine()}-linux/rwa_friction.so": shared_library(sources, "--to fmu"),
        "sources/buildDescription.xml": render("buildDescription.xml", model),
        **{f"sources/{name}": content for name, content in sources.items()},
    }
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)  # dated 1980, for equal bytes
    return {"rwa_friction.fmu": file.getvalue()}


def shared_library(sources: dict[str, bytes], place: str, hidden: bool = True) -> bytes:
    """Compile C sources with the system's compiler, or that of the environment's CC; errors as in `fmu_files`.

    With `hidden`, only functions marked so are exported: the symbols of two FMUs in one process do not clash.
    """
    compiler = shlex.split(os.environ.get("CC", "cc"))
    if sys.platform != "linux":
        raise InputError(place, "writes a binary for Linux; --to c gives the source, for any system")
    if not compiler or shutil.which(compiler[0]) is None:
        raise InputError(place, "needs a C compiler (cc, or $CC): apt-get install gcc; --to c needs none")
    with tempfile.TemporaryDirectory() as folder:
        for name, content in sources.items():
            Path(folder, name).write_bytes(content)
        units = [name for name in sources if name.endswith(".c")]
        visibility = ["-fvisibility=hidden"] if hidden else []
        command = [*compiler, *FLAGS, *visibility, *units, "-lm", "-o", "model.so"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603 - $CC is the user's
        if done.returncode != 0:
            raise RwaMonitorError(f"{place}: {compiler[0]} fails: {done.stderr.strip()[:500]}")
        return Path(folder, "model.so").read_bytes()


# ---- the settings of the onboard detector, for one wheel -------------------------------------------------------------


NODES: Final = 257  # RWA_TAIL_NODES
NOT_ONBOARD: Final = ("angle_per_x", "stretch_hop")  # settings for statistics that the detector does not collect


def detector_files(model: FrictionModel) -> dict[str, bytes]:
    """Return `rwa_detector_settings.h`: what the monitor derives from the wheel file before a window's first sample.

    The largest outlier of noise with heavy tails, by Student's t, is tabulated over the ratio of two quantiles.

    Raises
    ------
    InputError
        If the wheel's viscous friction is not proportional to the speed, as the detector assumes.
    """
    wheel = model.wheel
    if viscous := viscous_effects(wheel):
        names = " and ".join(effect.name for effect in viscous)
        what = f"{names} changes its viscous friction, which the detector takes to be in proportion to the speed"
        raise InputError(f"wheel {wheel.name}", f"{what}: remove the effect, or run the monitor", "effect")
    slots, asked = wheel.window.samples, wheel.window.run_length
    settings = WindowAccumulator(wheel).settings._asdict()
    ratio = np.geomspace(TAIL_RATIO[0], TAIL_RATIO[-1], NODES).tolist()
    ratio[0] = float(np.nextafter(TAIL_RATIO[0], np.inf))  # at the first value itself, tails are Gaussian

    def largest(chance: float, factor: float) -> list[float]:
        return [factor * largest_outlier((math.inf, CHI_MEDIAN, one * CHI_MEDIAN), 1.0, chance) for one in ratio]

    chance = outlier_chance(slots)
    fields: dict[str, float | list[float]] = {
        "slots": slots,
        **{name: value for name, value in settings.items() if name not in NOT_ONBOARD},
        "tail_ratio": ratio,
        "tail_outlier": largest(chance, 1.0),
        "tail_sure": largest(chance, TAIL_FACTOR) if asked is None else largest(1.0 / asked, 1.0),
    }
    lines = [f"    .{name} = {_literal(value)}," for name, value in fields.items()]
    head = f"/* Of wheel file {wheel.sha256()}; do not edit, export again. */"
    begin, end = "static const rwa_detector_settings rwa_detector_of_wheel = {", "};"
    return {"rwa_detector_settings.h": "\n".join([head, begin, *lines, end, ""]).encode()}


def _literal(value: float | list[float]) -> str:
    if isinstance(value, list):
        return "{" + ", ".join(map(repr, value)) + "}"
    return "NAN" if math.isnan(value) else repr(value)
