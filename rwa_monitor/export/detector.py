"""The settings of the onboard detector (`kernels/onboard/rwa_detector.h`) for one wheel, as a C header."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from rwa_monitor.changepoints.evidence import UNKNOWN_TAIL, WindowAccumulator
from rwa_monitor.changepoints.noise import TAIL_RATIO, largest_outlier, outlier_chance
from rwa_monitor.errors import InputError
from rwa_monitor.export.model import FrictionModel
from rwa_monitor.kernels.noise import CHI_MEDIAN
from rwa_monitor.wheel.effects.catalogue import viscous_effects

NODES: Final = 257  # RWA_TAIL_NODES
NOT_ONBOARD: Final = ("angle_per_x", "stretch_hop")  # settings of the structure, which the detector does not collect


def detector_files(model: FrictionModel) -> dict[str, bytes]:
    """Return `rwa_detector_settings.h`: what the monitor derives from the wheel file before a window's first sample.

    Of noise with heavy tails the largest outlier needs Student's t, which is tabulated over the ratio of two quantiles.

    Raises
    ------
    InputError
        If the wheel's viscous friction is more than its coefficient times the speed, which the detector takes it for.
    """
    wheel = model.wheel
    if viscous := viscous_effects(wheel):
        names = " and ".join(effect.name for effect in viscous)
        what = f"{names} changes its viscous friction, which the detector takes to be in proportion to the speed"
        raise InputError(f"wheel {wheel.name}", f"{what}: remove the effect, or run the monitor", "effect")
    slots, asked = wheel.window.samples, wheel.window.run_length
    settings = WindowAccumulator(wheel).settings._asdict()
    ratio = np.geomspace(TAIL_RATIO[0], TAIL_RATIO[-1], NODES).tolist()
    ratio[0] = float(np.nextafter(TAIL_RATIO[0], np.inf))  # at the first, tails are Gaussian

    def largest(chance: float, factor: float) -> list[float]:
        return [factor * largest_outlier((math.inf, CHI_MEDIAN, one * CHI_MEDIAN), 1.0, chance) for one in ratio]

    chance = outlier_chance(slots)
    fields: dict[str, float | list[float]] = {
        "slots": slots,
        **{name: value for name, value in settings.items() if name not in NOT_ONBOARD},
        "tail_ratio": ratio,
        "tail_outlier": largest(chance, 1.0),
        "tail_sure": largest(chance, UNKNOWN_TAIL) if asked is None else largest(1.0 / asked, 1.0),
    }
    lines = [f"    .{name} = {_literal(value)}," for name, value in fields.items()]
    head = f"/* Of wheel file {wheel.sha256()}; do not edit, export again. */"
    begin, end = "static const rwa_detector_settings rwa_detector_of_wheel = {", "};"
    return {"rwa_detector_settings.h": "\n".join([head, begin, *lines, end, ""]).encode()}


def _literal(value: float | list[float]) -> str:
    if isinstance(value, list):
        return "{" + ", ".join(map(repr, value)) + "}"
    return "NAN" if math.isnan(value) else repr(value)
