"""Terms: an effect of the catalogue, at one shape, put into columns of the search problem, and what adding it is worth.

Which shape is the best is found in `shape_profile`.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from rwa_monitor.discrepancy.base_fit import (
    strong_level,
)
from rwa_monitor.discrepancy.jump_terms import LEAD, SLOPE_REACH, without_pulses
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import Record
from rwa_monitor.discrepancy.unnamed import UnnamedEffect
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect
from rwa_monitor.wheel.effects.formula import Formula
from rwa_monitor.wheel.effects.torque_ripple import TorqueRipple

TINY: Final = 1e-100  # of what is divided by


@dataclass(frozen=True, slots=True)
class Term:
    """An effect with shape parameters fixed, as columns.

    Attributes
    ----------
    effect
        Its class.
    shape
        Values of the shape parameters.
    columns
        float64 (n, p) at the joined samples, multiplied by s, at unit strength.
    low, high
        float64 (p,), bounds of the strengths.
    own
        Whether the columns are of these data alone: effect and shape do not determine them.
    price
        Of the parameters, in units of log N, where that is not their number.
    """

    effect: type[MeanEffect]
    shape: Mapping[str, float]
    columns: FloatArray
    low: FloatArray
    high: FloatArray
    own: bool = False
    price: float | None = None

    @property
    def name(self) -> Hashable:
        """Return which columns these are, of one problem; None where effect and shape do not determine them."""
        return None if self.own or depends_on_level(self.effect) else _name(self.effect, self.shape)

    @property
    def parameters(self) -> float:
        """Return what the parameters cost, in units of log N: their number, shape included, where nothing is given."""
        return len(self.effect.parameters) if self.price is None else self.price


def make_term(problem: Problem, effect: type[MeanEffect], shape: Mapping[str, float], level: FloatArray | None) -> Term:
    """Evaluate an effect's columns on all records.

    Parameters
    ----------
    level
        Current estimate of the dry level at the joined samples [N m], for effects that scale with it.
    """
    return make_term_with(problem, effect, shape, followed_level(problem, effect, level))


class FollowedLevel:
    """A level with only its strong jumps, which columns follow, and the channels that it gives; see `followed_level`.

    The channels are the same for every shape of an effect: they are made when they are first asked for.

    Attributes
    ----------
    problem
        The data.
    level
        float64 (n,), the level at the joined samples [N m].
    """

    def __init__(self, problem: Problem, level: FloatArray) -> None:
        self.problem = problem
        self.level = level
        self._cleaned: dict[float, FollowedLevel] = {}

    def without_pulses(self, lead: float) -> FollowedLevel:
        """Return the level with its pulses taken out, see `jump_terms`."""
        if lead not in self._cleaned:
            self._cleaned[lead] = FollowedLevel(self.problem, without_pulses(self.level, lead))
        return self._cleaned[lead]

    @cached_property
    def step(self) -> float:
        """A small step of the level [N m], for differences."""
        return 1e-3 * float(np.mean(np.abs(self.level))) or 1.0

    @cached_property
    def stepped(self) -> FollowedLevel:
        """The level a small step up."""
        return FollowedLevel(self.problem, self.level + self.step)

    @cached_property
    def channels(self) -> list[Channels]:
        """The channels of each record with this level, and with the motor torque that would overcome it."""
        problem, level = self.problem, self.level
        slope = float((problem.z - level) @ problem.speed / max(float(problem.speed @ problem.speed), 1e-300))
        per_record = []
        for record, dry in zip(problem.records, problem.spread(level), strict=True):
            channels = replace(record.channels, dry_level_Nm=dry)
            if record.accelerating_torque_Nm is not None:
                motor = record.accelerating_torque_Nm + channels.direction * dry + slope * _steady_speed(record)
                rate = np.gradient(motor, channels.sample_period_s)
                channels = replace(channels, motor_torque_Nm=motor, motor_torque_rate_Nm_s=rate)
            per_record.append(channels)
        return per_record

    def columns(self, effect: type[MeanEffect], shape: Mapping[str, float]) -> FloatArray:
        """Evaluate the columns of an effect with this level, float64 (n, p), multiplied by s."""
        return _evaluate(self.problem, effect, shape, self.channels)


def _steady_speed(record: Record) -> FloatArray:
    """Return the speed [rad/s] whose slope shares no noise with friction derived from it, float64 (slots,).

    The slope of a moving mean is given by what enters and leaves it: so far away that no derivative reaches there.
    """
    speed = record.channels.speed_rad_s
    if not record.friction_is_derived:
        return speed
    reach = record.derivative_slots // 2 + SLOPE_REACH + 1
    known = np.isfinite(speed)
    sums = uniform_filter1d(np.where(known, speed, 0.0), 2 * reach + 1, mode="nearest")
    share = uniform_filter1d(known.astype(np.float64), 2 * reach + 1, mode="nearest")
    return np.where(known, sums / np.where(known, share, 1.0), np.nan)


def followed_level(problem: Problem, effect: type[MeanEffect], level: FloatArray | None) -> FollowedLevel | None:
    """Return what of a level an effect's columns follow; None where they follow none.

    Only strong jumps count: many weak ones may follow another effect, and the column would then follow it as well.
    """
    if level is None or not depends_on_level(effect):
        return None
    decides = level, problem.z, problem.records
    price = problem.noise.long_run_variance
    return problem.recent.get(
        decides, price, lambda: FollowedLevel(problem.with_empty_caches(), strong_level(problem, level))
    )


def make_term_with(
    problem: Problem,
    effect: type[MeanEffect],
    shape: Mapping[str, float],
    followed: FollowedLevel | None,
    *,
    keep: bool = False,
) -> Term:
    """Evaluate an effect's columns, given the level that they follow: the same for many shapes of the effect.

    `keep`: other models will ask for this shape, too.
    """
    strengths = effect.strength_parameters()
    key = _name(effect, shape)
    columns = problem.columns.get(key)
    if columns is None and followed is not None:
        columns = _columns_with_level(effect, shape, followed)
    if columns is None:
        by_angle = issubclass(effect, TorqueRipple) or getattr(effect, "variable", "") == "angle"
        channels = [record.undrifted if by_angle else record.channels for record in problem.records]
        if issubclass(effect, (Formula, UnnamedEffect)):  # of any form: of that of the noise that both share, too
            steady = [_steady_speed(record) for record in problem.records]
            channels = [replace(one, speed_rad_s=speed) for one, speed in zip(channels, steady, strict=True)]
        columns = _evaluate(problem, effect, shape, channels)
        if keep and not depends_on_level(effect):
            problem.columns.put(key, columns)
    low, high = (np.array([getattr(p, end) for p in strengths]) for end in ("low", "high"))
    if not issubclass(effect, UnnamedEffect):
        # No part of the friction is larger than all of it: parts that cancel each other fit anything.
        share = max(effect.largest_share(record.channels) for record in problem.records)
        most = (
            share
            * problem.largest_friction_Nm
            / np.maximum(np.abs(columns.T, order="C").max(axis=1, initial=0.0), TINY)
        )
        low, high = np.maximum(low, -most), np.minimum(high, most)
    return Term(effect, dict(shape), columns, low, high, price=_price(problem, effect, shape))


def _price(problem: Problem, effect: type[MeanEffect], shape: Mapping[str, float]) -> float:
    """Return what parameters cost in units of log N: one each, and that an effect was chosen among many of its kind.

    A choice is what physics expects: off it costs a parameter more. What has one choice alone costs nothing there.
    """
    between = [p for p in effect.parameters if p.between]
    choice = effect.choice_deviance / problem.log_size
    off = sum(shape[p.name] not in p.choices for p in between)
    return len(effect.parameters) - sum(len(p.choices) == 1 for p in between) + off + choice


def _evaluate(
    problem: Problem, effect: type[MeanEffect], shape: Mapping[str, float], channels: Sequence[Channels]
) -> FloatArray:
    """Evaluate the columns on the channels of each record, joined and multiplied by s, zero where unknown, (n, p)."""
    per_record = [effect.columns(of_one, shape)[0] for of_one in channels]
    columns = problem.gather(per_record)
    if not np.isfinite(columns).all():
        np.nan_to_num(columns, copy=False)
    columns *= problem.sign[:, None]
    return columns


def _name(effect: type[MeanEffect], shape: Mapping[str, float]) -> Hashable:
    return effect.name, tuple(shape.items())


def depends_on_level(effect: type[MeanEffect]) -> bool:
    """Return whether an effect's columns follow from the dry level, by itself or as a part of the motor torque."""
    return effect.uses_level or "motor_torque_Nm" in effect.needs


def _columns_with_level(effect: type[MeanEffect], shape: Mapping[str, float], followed: FollowedLevel) -> FloatArray:
    """Evaluate the columns with a dry level, and with the motor torque that accelerates and overcomes that level.

    The measured motor torque holds the very friction that is to be explained, jumps and noise included: less J·dω/dt it
    would explain everything by itself. A column that follows the level would explain its jumps by themselves, too: the
    part in proportion to the level is left to the levels.
    """
    if LEAD in shape:
        followed = followed.without_pulses(shape[LEAD])
    level, columns = followed.level, followed.columns(effect, shape)
    if not effect.uses_level:
        share = np.median((followed.stepped.columns(effect, shape) - columns) / followed.step, axis=0)
        return np.asarray(columns - level[:, None] * share, dtype=np.float64)
    centred = level - level.mean()
    energy = float(centred @ centred)
    if energy <= (1e-9 * float(np.max(np.abs(level)))) ** 2 * level.size:
        return columns
    return np.asarray(columns - centred[:, None] * (centred @ columns / energy), dtype=np.float64)


def design_of(problem: Problem, terms: Sequence[Term]) -> FloatArray:
    """Return the columns of a model, float64 (n, 1 + p): speed, then the terms'."""
    return np.column_stack([problem.speed, *(term.columns for term in terms)])


def available(problem: Problem, effect: type[MeanEffect]) -> str | None:
    """Return which channel an effect lacks in these records, or None when it has all."""
    for channel in sorted(effect.needs):
        if any(getattr(record.channels, channel) is None for record in problem.records):
            return channel
    return None
