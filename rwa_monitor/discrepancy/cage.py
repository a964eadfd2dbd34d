"""Bursts of a cage: found after the first search, then left out of the second, which they would mislead.

Drag that comes and goes in a band of speeds is jumps to the segmentation, another switching system to the attribution,
and a law of speed to a curve. Its noise shows it: no level and no slow effect makes neighbours differ in bursts. Once
that is seen the slots in bursts are left out of anything else, and the search begins again without them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import binary_dilation

from rwa_monitor.discrepancy.models import Model
from rwa_monitor.discrepancy.noise_effects import accepted, is_quantised, residual_on_slots
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import Record
from rwa_monitor.discrepancy.result import FoundEffect
from rwa_monitor.samples import BoolArray
from rwa_monitor.wheel.effects.cage_instability import CageInstability
from rwa_monitor.wheel.effects.likelihood import LikelihoodFit

MARGIN: Final = 8  # slots on each side of a burst: where exactly it begins is not known
BAND_MARGIN: Final = 1.2  # of the band's half width, in which bursts too short to be seen may be left


@dataclass(frozen=True, slots=True)
class CageBursts:
    """Bursts of a cage.

    Attributes
    ----------
    effect
        What is named.
    in_burst, in_band
        For each record bool (slots,): slots in or beside a burst, and slots in the band.
    """

    effect: FoundEffect
    in_burst: tuple[BoolArray, ...]
    in_band: tuple[BoolArray, ...]

    def quiet(self, records: Sequence[Record]) -> list[Record]:
        """Return the records without the slots in bursts."""
        return [
            replace(record, used=record.used & ~burst) for record, burst in zip(records, self.in_burst, strict=True)
        ]


def cage_bursts(problem: Problem, model: Model) -> CageBursts | None:
    """Return the bursts of a cage that a model's residual shows, or None."""
    if any(is_quantised(problem, model, index) for index in range(len(problem.records))):
        return None  # rounding errors come and go with the acceleration
    fits, bursts, bands = [], [], []
    for index, record in enumerate(problem.records):
        fitted, on = _fit(problem, model, index)
        speed = np.abs(record.channels.speed_rad_s)
        off_centre = np.abs(speed - fitted.values["band_speed_rad_s"])
        inside = off_centre < BAND_MARGIN * fitted.values["band_half_width_rad_s"]
        if fitted.penalised_gain <= 0.0:
            on, inside = np.zeros_like(on), np.zeros_like(on)
        fits.append(fitted)
        bursts.append(binary_dilation(on, iterations=MARGIN) if on.any() else on)
        bands.append(inside)
    found = accepted(problem, {CageInstability.name: fits})
    return CageBursts(found[0], tuple(bursts), tuple(bands)) if found else None


def largest_burst_gain(problem: Problem, model: Model) -> float:
    """Return the penalised gain of bursts over all records, whether accepted or not."""
    return sum(_fit(problem, model, index)[0].penalised_gain for index in range(len(problem.records)))


def _fit(problem: Problem, model: Model, index: int) -> tuple[LikelihoodFit, BoolArray]:
    """Fit bursts to what a record holds beside slope and effects: levels stay in, since they may be bursts."""
    _, good = residual_on_slots(problem, model, index)
    record, begin, end = problem.records[index], int(problem.starts[index]), int(problem.starts[index + 1])
    along = (model.fit.level + model.fit.residual + problem.z_measured - problem.z)[begin:end]
    left = np.full(record.used.size, np.nan)
    left[problem.slot[begin:end]] = along * problem.sign[begin:end]
    return CageInstability.fit_bursts(left, record.channels, good)
