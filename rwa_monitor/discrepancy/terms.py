"""Terms, each an effect at one shape, evaluated as columns of the search problem, and models made of them.

`shape_profile` finds the best shape of a term, `search` the best terms of a model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from rwa_monitor.discrepancy.base_fit import Fit, strong_level
from rwa_monitor.discrepancy.jump_terms import LEAD, SLOPE_REACH, without_pulses
from rwa_monitor.discrepancy.likelihood import NoiseLaw
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import Record
from rwa_monitor.discrepancy.unnamed import UnnamedEffect
from rwa_monitor.samples import TINY, FloatArray, IntArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Shape
from rwa_monitor.wheel.effects.formula import Formula
from rwa_monitor.wheel.effects.torque_ripple import TorqueRipple


@dataclass(frozen=True, slots=True)
class Term:
    """An effect with fixed shape parameters, as columns.

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
    parameters
        Penalty for its parameters, in units of log N: their number, shape included, unless `_price` differs.
    places
        int64 (p,), sample at which each column begins where the columns are jumps of these records, as levels are.
    """

    effect: type[MeanEffect]
    shape: Shape
    columns: FloatArray
    low: FloatArray
    high: FloatArray
    parameters: float
    places: IntArray | None = None


def make_term(
    problem: Problem,
    effect: type[MeanEffect],
    shape: Shape,
    level: FloatArray | None,
    beside: FloatArray | None = None,
    *,
    keep: bool = False,
) -> Term:
    """Evaluate an effect's columns on all records.

    Parameters
    ----------
    level
        Current estimate of the dry level at the joined samples [N m], for effects that scale with it.
    beside
        Torque of a model's effects along the rotation, float64 (n,) [N m], for effects that scale with the motor's
        torque, which overcomes it, too. None: zero.
    keep
        Whether to cache the columns: other models will need this shape, too.
    """
    followed, key = _followed_level(problem, effect, level, beside), (effect.name, tuple(shape.items()))
    columns = problem.columns.get(key) if followed is None else _columns_with_level(effect, shape, followed)
    if columns is None:
        by_angle = issubclass(effect, TorqueRipple) or getattr(effect, "variable", "") == "angle"
        channels = [record.undrifted if by_angle else record.channels for record in problem.records]
        if issubclass(effect, (Formula, UnnamedEffect)):  # would also fit noise that derived friction shares
            steady = [_decorrelated_speed(record) for record in problem.records]
            channels = [replace(one, speed_rad_s=speed) for one, speed in zip(channels, steady, strict=True)]
        columns = _evaluate(problem, effect, shape, channels)
        if keep:
            problem.columns.put(key, columns)
    low, high = (np.array([getattr(p, end) for p in effect.strength_parameters()]) for end in ("low", "high"))
    if not (issubclass(effect, UnnamedEffect) or effect.is_part_of_viscous):
        # No part may exceed the largest friction: parts that cancel each other would fit anything. But a part of the
        # viscous friction may, at a temperature outside of the record.
        share = max(effect.largest_share(record.channels) for record in problem.records)
        largest = np.abs(columns.T, order="C").max(axis=1, initial=0.0)
        most = share * problem.largest_friction_Nm / np.maximum(largest, TINY)
        low, high = np.maximum(low, -most), np.minimum(high, most)
    return Term(effect, dict(shape), columns, low, high, _price(problem, effect, shape))


@dataclass(eq=False)
class FollowedLevel:
    """A dry level with only its strong jumps, for level-dependent columns, and its channels; see `_followed_level`.

    The channels are the same for every shape of an effect: they are computed once, on first use.

    Attributes
    ----------
    problem
        The data.
    level, beside
        float64 (n,), the level at the joined samples, and the torque of the effects along the rotation [N m].
    """

    problem: Problem
    level: FloatArray
    beside: FloatArray
    _cleaned: dict[float, FollowedLevel] = field(default_factory=dict)

    def without_pulses(self, lead: float) -> FollowedLevel:
        """Return the level with its pulses removed, see `jump_terms`."""
        if lead not in self._cleaned:
            self._cleaned[lead] = FollowedLevel(self.problem, without_pulses(self.level, lead), self.beside)
        return self._cleaned[lead]

    @cached_property
    def step(self) -> float:
        """A small step of the level [N m], for difference quotients."""
        return 1e-3 * float(np.mean(np.abs(self.level))) or 1.0

    @cached_property
    def stepped(self) -> FollowedLevel:
        """The level, higher by the small step."""
        return FollowedLevel(self.problem, self.level + self.step, self.beside)

    @cached_property
    def channels(self) -> list[Channels]:
        """The channels of each record with this level, and with the motor torque that would overcome it."""
        problem, added = self.problem, self.level + self.beside
        slope = float((problem.z - added) @ problem.speed / max(float(problem.speed @ problem.speed), TINY))
        per_record = []
        levels, drags = problem.spread(self.level), problem.spread(added)
        for record, dry, drag in zip(problem.records, levels, drags, strict=True):
            channels = replace(record.channels, dry_level_Nm=dry)
            if record.accelerating_torque_Nm is not None:
                motor = record.accelerating_torque_Nm + channels.direction * drag + slope * _decorrelated_speed(record)
                rate = np.gradient(motor, channels.sample_period_s)
                channels = replace(channels, motor_torque_Nm=motor, motor_torque_rate_Nm_s=rate)
            per_record.append(channels)
        return per_record

    def columns(self, effect: type[MeanEffect], shape: Shape) -> FloatArray:
        """Evaluate the columns of an effect with this level, float64 (n, p), multiplied by s."""
        return _evaluate(self.problem, effect, shape, self.channels)


def _decorrelated_speed(record: Record) -> FloatArray:
    """Return a speed [rad/s] whose time derivative shares no noise with friction derived from it, float64 (slots,).

    It is a moving mean: its derivative depends on the ends of the window alone, which the derivative filter of the
    friction does not reach. Given friction shares no noise: the speed is returned as it is.
    """
    speed = record.channels.speed_rad_s
    if not record.friction_is_derived:
        return speed
    reach = record.derivative_slots // 2 + SLOPE_REACH + 1
    known = np.isfinite(speed)
    sums = uniform_filter1d(np.where(known, speed, 0.0), 2 * reach + 1, mode="nearest")
    share = uniform_filter1d(known.astype(np.float64), 2 * reach + 1, mode="nearest")
    return np.where(known, sums / np.where(known, share, 1.0), np.nan)


def _followed_level(
    problem: Problem, effect: type[MeanEffect], level: FloatArray | None, beside: FloatArray | None = None
) -> FollowedLevel | None:
    """Return the level that an effect's columns follow, with only its strong jumps; None where they follow none.

    Many weak jumps may approximate another effect, and the columns would then follow that effect as well.
    """
    if level is None or not depends_on_level(effect):
        return None
    decides = level, beside, problem.z, problem.records, problem.noise
    added = np.zeros(problem.size) if beside is None else beside
    return problem.recent.get(
        decides, lambda: FollowedLevel(problem.with_empty_caches(), strong_level(problem, level), added)
    )


def _price(problem: Problem, effect: type[MeanEffect], shape: Shape) -> float:
    """Return the penalty for parameters in units of log N: one each, plus that for a choice among many of its kind.

    Of a parameter that may lie off its choices, which physics expects, a value off them costs one more; one that has a
    single choice costs nothing there.
    """
    between = [p for p in effect.parameters if p.between]
    choice = effect.choice_deviance / problem.log_size
    off = sum(shape[p.name] not in p.choices for p in between)
    return len(effect.parameters) - sum(len(p.choices) == 1 for p in between) + off + choice


def _evaluate(problem: Problem, effect: type[MeanEffect], shape: Shape, channels: Sequence[Channels]) -> FloatArray:
    """Evaluate the columns on the channels of each record, joined and multiplied by s, zero where unknown, (n, p)."""
    per_record = [effect.columns(of_one, shape)[0] for of_one in channels]
    columns = problem.gather(per_record)
    if not np.isfinite(columns).all():
        np.nan_to_num(columns, copy=False)
    columns *= problem.sign[:, None]
    return columns


def depends_on_level(effect: type[MeanEffect]) -> bool:
    """Return whether an effect's columns depend on the dry level, directly or as a part of the motor torque."""
    return effect.uses_level or "motor_torque_Nm" in effect.needs


def _columns_with_level(effect: type[MeanEffect], shape: Shape, followed: FollowedLevel) -> FloatArray:
    """Evaluate the columns with a dry level, and with the motor torque that accelerates the wheel against that level.

    The measured motor torque is not used: it contains the friction to be explained, with jumps and noise, and less
    J·dω/dt it would explain everything. The part of a column in proportion to the level is subtracted: it would
    explain jumps by themselves.
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


def available(problem: Problem, effect: type[MeanEffect]) -> str | None:
    """Return which channel an effect lacks in these records, or None when it has all."""
    channels = [record.channels for record in problem.records]
    return next((one for one in sorted(effect.needs) if any(getattr(of, one) is None for of in channels)), None)


# ---- models: terms with a fit, how they grew, and what was found -----------------------------------------------------


MODEL_ERROR: Final = 0.1  # of the torque of a law: a real machine may deviate from it by so much, a working assumption


@dataclass(frozen=True, slots=True)
class Model:
    """A set of effects and its fit.

    Attributes
    ----------
    terms
        The effects.
    fit
        Jumps, coefficients, level and residual.
    law
        The law of the noise that was fitted with it.
    score
        See `score`; lower is better.
    """

    terms: tuple[Term, ...]
    fit: Fit
    law: NoiseLaw
    score: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(term.effect.name for term in self.terms)

    def strengths(self, index: int) -> FloatArray:
        """Return the fitted strengths of term `index`."""
        begin = 1 + sum(term.columns.shape[1] for term in self.terms[:index])
        return self.fit.coefficients[begin : begin + self.terms[index].columns.shape[1]]

    def torque(self, index: int) -> FloatArray:
        """Return the torque of term `index` along the rotation, float64 (n,) [N m]."""
        return np.asarray(self.terms[index].columns @ self.strengths(index))

    @property
    def of_own_jumps(self) -> FloatArray:
        """The torque of jumps that are of these records alone (`Term.places`), float64 (n,) [N m]."""
        own = (self.torque(i) for i, term in enumerate(self.terms) if term.places is not None)
        return sum(own, np.zeros_like(self.fit.level))

    @property
    def is_possible(self) -> bool:
        """Whether all strengths are physically possible, given the dry and viscous friction of the model."""
        dry, viscous = float(self.fit.level.mean()), float(self.fit.coefficients[0])
        return all(term.effect.is_possible(self.strengths(i), dry, viscous) for i, term in enumerate(self.terms))

    def is_minor(self, index: int, sign: FloatArray) -> bool:
        """Return whether a term's torque, where it acts, is within MODEL_ERROR of the largest other term's.

        Where the wheel reverses, odd and even terms are not compared: an odd law has odd errors, an even one even ones.

        Parameters
        ----------
        index
            Which of the terms.
        sign
            float64 (n,), direction of rotation. The means of the others do not count: a constant has no model error.
        """
        opposite = {"odd": "even", "even": "odd"}.get(self.terms[index].effect.parity) if np.ptp(sign) else None
        torques = [(term, sign * self.torque(i)) for i, term in enumerate(self.terms)]
        own = torques.pop(index)[1] ** 2
        others = [torque - torque.mean() for term, torque in torques if term.effect.parity != opposite]
        largest = max((float(own @ other**2) for other in others), default=0.0)
        return float(own @ own) < MODEL_ERROR**2 * largest


def nested_to(model: Model, nested: Sequence[Model]) -> tuple[Model, ...]:
    """Return a model after those of the nested ones that have fewer effects, and none that it has not."""
    return *(one for one in nested if set(one.names) < set(model.names)), model


@dataclass(frozen=True, slots=True)
class Found:
    """One effect that the search accepted.

    Attributes
    ----------
    name
        Catalogue name.
    gain
        Increase of the score when the effect is left out and all else refitted.
    equivalent
        Other names that are as good in its place (difference below `fitting.EQUIVALENT_WITHIN`).
    """

    name: str
    gain: float
    equivalent: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SearchResult:
    """What the search over mean effects found.

    Attributes
    ----------
    nested
        Models from the base upwards, one effect more at each step.
    testable, untestable
        The candidates that the data can test, and the names of those that they cannot, with what is missing.
    found
        The effects of the last model, strongest first; none before they are judged.
    """

    nested: tuple[Model, ...]
    testable: tuple[type[MeanEffect], ...]
    untestable: tuple[tuple[str, str], ...]
    found: tuple[Found, ...] = ()
