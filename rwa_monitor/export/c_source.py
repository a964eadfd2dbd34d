"""The friction model as one C99 file and its header: no allocation, libm alone; what leaving effects out costs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import jinja2
import numpy as np

from rwa_monitor.export.model import FrictionModel, Part, literal
from rwa_monitor.samples import FloatArray
from rwa_monitor.simulation.motion import wheel_angle
from rwa_monitor.simulation.record import COUPLING_ROUNDS, couple
from rwa_monitor.wheel.effects.base import Channels, Effect, MeanEffect, NoiseEffect
from rwa_monitor.wheel.effects.viscosity_temperature import ORIGIN_degC
from rwa_monitor.words import SOFTWARE

SLOTS: Final = 20_001  # of a sweep
SWEEP_S: Final = 2_000.0  # s, from rest to the largest speed, down to the opposite one, and back to rest
SWING_K: Final = 5.0  # K to both sides, over the sweep: the largest of an orbit (`simulation.record`)


def sweep(model: FrictionModel, top_rad_s: float) -> Channels:
    """Return a motion from rest to a speed, to its opposite and back, evenly accelerated; 15 to 25 °C on the way."""
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
        bearing_temperature_degC=ORIGIN_degC + SWING_K * np.sin(2.0 * np.pi * time / SWEEP_S),
        dry_level_Nm=level,
        sample_period_s=period_s,
        good=np.ones(SLOTS, dtype=np.bool_),
    )


def base_law(model: FrictionModel, speed_rad_s: FloatArray) -> FloatArray:
    """Return dry and viscous friction without jumps and effects [N m]."""
    return np.sign(speed_rad_s) * model.nominal.dry_torque_Nm + model.nominal.viscous_Nm_s_rad * speed_rad_s


def torque(model: FrictionModel, effects: Sequence[Effect], channels: Channels) -> FloatArray:
    """Return the friction with some effects, as it is simulated, without jumps [N m]."""
    coupled = couple([effect for effect in effects if isinstance(effect, MeanEffect)], channels)
    return sum(coupled.values(), start=base_law(model, channels.speed_rad_s))


def rms(values: FloatArray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def cost(part: Part, model: FrictionModel) -> str:
    """Return in words what leaving out an effect costs, over a sweep to the nominal speed."""
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
    """Return a text that stays inside of a comment in C, in ASCII: no file's content becomes code."""
    text = " ".join(text.translate(PLAIN).encode("ascii", "replace").decode().split())
    return re.sub(r"(?<=\?)(?=\?)", " ", text.replace("*/", "* /").replace("/*", "/ *"))


def error(std: float | None) -> str:
    """Return a standard deviation as it is stated."""
    return "not known" if std is None else f"{std:.2g}"


def constants(part: Part) -> str:
    """Return a line of comment for each constant of an effect, with its error."""
    lines = []
    for one in part.constants():
        unit = "" if one["unit"] == "-" else f" {comment(one['unit'])}"
        lines.append(f" *   {one['name']} = {one['value']!r}{unit}, error {error(one['std'])}")
    return "\n".join(lines)


def recursions(model: FrictionModel) -> str:
    """Return the functions of the kernels' header that the model calls."""
    parts = re.split(r"/\* -{4} (\w+) -+ \*/\n", RECURSIONS.read_text(encoding="utf-8"))
    return "".join(
        text for name, text in zip(parts[1::2], parts[2::2], strict=True) if name == "rwa_sign" or model.uses(name)
    )


def render(template: str, model: FrictionModel, **more: Any) -> str:
    """Return a template of this room, filled in for a model."""
    environment = jinja2.Environment(  # noqa: S701 - C is no HTML; XML escapes by the filter
        loader=jinja2.FileSystemLoader(FOLDER),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {"c": literal, "comment": comment, "error": error}
    environment.globals |= {"constants": constants, "cost": cost}
    known = {"model": model, "wheel": model.wheel, "software": SOFTWARE}
    return environment.get_template(f"{template}.jinja").render(**known, **more)


def c_files(model: FrictionModel) -> dict[str, str]:
    """Return header and source by the names of their files."""
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
