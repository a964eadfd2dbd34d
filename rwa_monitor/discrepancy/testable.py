"""Which effects a motion can show: by their columns, never by their names.

What the base law spans is not testable, nor what is no law of the speed but follows the speed in this motion, as time,
acceleration and every lag do while a wheel runs down.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.signal import savgol_filter

from rwa_monitor.discrepancy.likelihood import Series
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.score import term_rows
from rwa_monitor.discrepancy.shape_profile import middle_shape
from rwa_monitor.discrepancy.terms import available, make_term
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect

KNOTS: Final = 12  # of a free curve over the speed, at quantiles of the speeds
SPANNED: Final = 0.02  # of a column's energy beyond the base law: so little is left of what a curve of the speed spans
LEAST_BEYOND: Final = 1e-5  # of its energy: what is left of a column by the noise of the speed, and by smoothing
EXPLAINED_AWAY: Final = 1e-8  # of its energy: what is left of a column that the base law spans
SLOW_WINDOWS: Final = 50  # in a record: a motion smoothed over one of them has lost its noise
FOLLOWS_THE_SPEED: Final = "a motion in which it does not follow the speed: several sweeps, or dwells"


def sort_out(
    problem: Problem, known: FloatArray, effects: Sequence[type[MeanEffect]], level: FloatArray
) -> tuple[list[type[MeanEffect]], list[tuple[str, str]]]:
    """Split the effects into those that the records can test and those they cannot, with what is missing.

    Parameters
    ----------
    problem
        The data.
    known
        float64 (p, n), regressors of the base law in the friction's own sign.
    effects
        Candidates.
    level
        float64 (n,), dry friction [N m], for columns that follow it.
    """
    series = Series.of(problem)
    curve = np.vstack([known, speed_curve(series)])
    calm = replace(problem, records=tuple(replace(r, channels=_calm(r.channels)) for r in problem.records))
    calm = calm.with_empty_caches()

    def missing(effect: type[MeanEffect]) -> str | None:
        """Return what an effect lacks: a channel, or a motion that sets it apart; None for nothing."""
        channel = available(problem, effect)
        if channel is not None:
            return channel
        shape = middle_shape(problem, effect)
        rows = term_rows(series, make_term(problem, effect, shape, level))
        if _beyond(rows, known) <= EXPLAINED_AWAY * float(np.sum(rows**2)):
            return effect.separate_by
        if _is_law_of_speed(problem, effect, shape):
            return None
        slow = term_rows(series, make_term(calm, effect, shape, level))
        beyond, least = _beyond(slow, known), LEAST_BEYOND * float(np.sum(slow**2))
        return FOLLOWS_THE_SPEED if _beyond(slow, curve) < max(SPANNED * beyond, least) else None

    reasons = list(zip(effects, problem.each(missing, effects), strict=True))
    testable = [effect for effect, reason in reasons if reason is None]
    return testable, [(effect.name, reason) for effect, reason in reasons if reason is not None]


def _beyond(rows: FloatArray, others: FloatArray) -> float:
    """Return the energy of rows that others do not span."""
    solution = np.linalg.lstsq(others.T, rows.T, rcond=1e-9)[0]
    return float(np.sum((rows.T - others.T @ solution) ** 2))


def speed_curve(series: Series) -> FloatArray:
    """Return a free curve over |ω|, one for each direction: hats between quantiles of the speeds, float64 (p, n)."""
    speed = np.abs(series.speed)
    knots = np.unique(np.quantile(speed, np.linspace(0.0, 1.0, KNOTS)))
    hats = np.stack([np.interp(speed, knots, height) for height in np.eye(knots.size)])
    rows = np.vstack([hats * (series.sign > 0), hats * (series.sign < 0)])
    return rows[rows.any(axis=1)]


def _calm(channels: Channels) -> Channels:
    """Return the motion without its noise, smoothed over a small part of the record."""
    width = max(len(channels) // SLOW_WINDOWS, 3) | 1
    known = np.isfinite(channels.speed_rad_s)
    filled = np.interp(np.arange(known.size), np.flatnonzero(known), channels.speed_rad_s[known])
    speed, rate = (savgol_filter(filled, width, 2, deriv=order, delta=channels.sample_period_s) for order in (0, 1))
    return replace(channels, speed_rad_s=speed, acceleration_rad_s2=rate)


def _is_law_of_speed(problem: Problem, effect: type[MeanEffect], shape: dict[str, float]) -> bool:
    """Return whether an effect depends on speed, direction and level alone: its columns then move with the samples."""
    if effect.needs:
        return False
    channels = problem.records[0].channels
    channels = replace(channels, dry_level_Nm=np.ones(len(channels)))
    order = np.random.default_rng(0).permutation(len(channels))
    nothing = np.zeros(len(channels))
    moved = replace(
        channels,
        speed_rad_s=channels.speed_rad_s[order],
        direction=channels.direction[order],
        good=channels.good[order],
        acceleration_rad_s2=nothing,
        angle_rad=nothing,
    )
    here, there = effect.columns(channels, shape)[0], effect.columns(moved, shape)[0]
    return bool(np.array_equal(np.nan_to_num(here[order]), np.nan_to_num(there)))
