"""Which manoeuvre to fly next: the one that would best separate the leading causes.

For each manoeuvre of a small library the motion is computed, the torque that each leading cause would make there is
computed, and the best imitation of it by each alternative is fitted (shape profiled, level and slope free). The
residual sum of squares of the imitation, over 2σ², is the expected difference of log-likelihood.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from scipy.ndimage import uniform_filter1d

from rwa_monitor.discrepancy.hypotheses import not_testable
from rwa_monitor.discrepancy.likelihood import ACCEPT_GAIN, NO_JUMPS, NoiseLaw
from rwa_monitor.discrepancy.problem import Problem, rms
from rwa_monitor.discrepancy.record import Record
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.discrepancy.score import Background
from rwa_monitor.discrepancy.shape_profile import middle_shape, profile
from rwa_monitor.discrepancy.terms import Model, make_term
from rwa_monitor.samples import SECONDS_PER_HOUR, FloatArray, IntArray
from rwa_monitor.simulation.motion import ORBIT_S
from rwa_monitor.wheel.effects.base import Channels
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, MEAN_EFFECTS
from rwa_monitor.wheel.wheel import Wheel

DURATION_S: Final = 2400.0  # of a manoeuvre: less than half an orbit
UNINFORMATIVE: Final = 0.1  # nats: odds of 1.1 to 1
DECIDES: Final = 5.0  # nats: one cause is then 150 times as likely as the other
UNTESTED_SHARE: Final = 0.02  # of all friction (rms): the assumed size of an effect that is not tested yet
MAX_SLOTS: Final = 20_000  # longer manoeuvres have longer slots
RAMP_S: Final = 20.0  # over which a wheel can change its speed by a good part of its range
IMITATION_SHARE: Final = 0.01  # of the found effect's energy that an alternative must be able to reproduce
THERMAL_SWING_K: Final = 3.0  # of the bearing over an orbit; 1–5 K are common


Pair = tuple[str, str]


@dataclass(frozen=True, slots=True)
class PlannedManoeuvre:
    """A manoeuvre and how well it separates causes.

    Attributes
    ----------
    name, description
        What to fly.
    duration_s
        How long it takes.
    separation
        Smallest expected log-likelihood difference between any two causes that are still open [nats]; above
        `DECIDES` the data decide.
    worst_pair
        The two causes with that separation; the second "" for the simulation without the first.
    shows
        Where manoeuvres are ranked for effects not tested yet: those that it would make identifiable.
    """

    name: str
    description: str
    duration_s: float
    separation: float
    worst_pair: Pair
    shows: tuple[str, ...] = ()

    @classmethod
    def of(cls, manoeuvre: Manoeuvre, separation: float, worst_pair: Pair, shows: tuple[str, ...] = ()) -> Self:
        """Return a manoeuvre of the library with how well it separates causes."""
        return cls(manoeuvre.name, manoeuvre.description, manoeuvre.duration_s, separation, worst_pair, shows)

    @property
    def nats_per_hour(self) -> float:
        """Separation per hour of flying it."""
        return self.separation * SECONDS_PER_HOUR / self.duration_s


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """A manoeuvre of the library.

    Attributes
    ----------
    name, description
        What to fly.
    speed
        ω over time [s] for a top speed [rad/s].
    duration_s
        How long it takes.
    jump_at
        Share of the manoeuvre after which dry friction jumps: it is flown until it does. None: no jump is expected.
    """

    name: str
    description: str
    speed: Callable[[FloatArray, float], FloatArray]
    duration_s: float = DURATION_S
    jump_at: float | None = None


def rank_manoeuvres(search: Search, alternatives: Sequence[str]) -> list[PlannedManoeuvre]:
    """Rank the library's manoeuvres by how well they separate the leading causes, best first.

    Parameters
    ----------
    search
        A finished search: gives noise, sizes, sample period and the speed range.
    alternatives
        Names of the leading mean effects: those found and their equivalents. One alone is compared with the base
        model: how surely the manoeuvre would confirm it.
    """
    worth = [
        (manoeuvre, _separations(search, laid_out, level, alternatives))
        for manoeuvre, laid_out, level in _as_problems(search)
    ]
    # Pairs that no manoeuvre separates, as these channels cannot distinguish them, do not count in the ranking.
    separable = {pair for _, of_pairs in worth for pair, nats in of_pairs.items() if nats >= UNINFORMATIVE}
    planned = [
        PlannedManoeuvre.of(manoeuvre, *min((of_pairs[pair], pair) for pair in separable & of_pairs.keys()))
        for manoeuvre, of_pairs in worth
        if separable & of_pairs.keys()
    ]
    return sorted(planned, key=lambda entry: -entry.separation)


def _separations(
    search: Search, laid_out: Problem, level: FloatArray, alternatives: Sequence[str]
) -> dict[Pair, float]:
    """Return the separation of each pair of causes, the smaller of both ways, or of one cause from none [nats]."""
    torques = {cause: _expected_torque(search, laid_out, cause, level) for cause in alternatives}
    separations: dict[Pair, float] = {}
    for cause, torque in torques.items():
        for other in torques if len(torques) > 1 else ("",):
            if other != cause and torque is not None:
                pair = (cause, other) if (other, cause) not in separations else (other, cause)
                least = separations.get(pair, np.inf)
                separations[pair] = min(least, _separation(laid_out, torque, other, level))
    return separations


def rank_for_untested(search: Search, untested: Sequence[str]) -> list[PlannedManoeuvre]:
    """Return the manoeuvres that would make effects identifiable that the records could not test.

    Each effect at UNTESTED_SHARE of all friction, its shape in the middle of what the manoeuvre can identify. The
    separation is the least among the effects that are identifiable.
    """
    size = UNTESTED_SHARE * rms(search.problem.z)
    planned = []
    for manoeuvre, laid_out, level in _as_problems(search):
        shown = []
        for name in untested:
            effect = MEAN_EFFECTS[name]
            column = make_term(laid_out, effect, middle_shape(laid_out, effect), level).columns[:, 0]
            of_column = rms(column)
            worth = _separation(laid_out, column * (size / of_column), "", level) if of_column > 0 else 0.0
            if worth > DECIDES:
                shown.append((worth, name))
        if shown:
            worth, name = min(shown)
            names = tuple(entry for _, entry in shown)
            planned.append(PlannedManoeuvre.of(manoeuvre, worth, (name, ""), names))
    return planned


def _as_problems(search: Search) -> Iterator[tuple[Manoeuvre, Problem, FloatArray]]:
    """Yield each manoeuvre, as a problem, with its dry level, float64 (n,) [N m]; none that awaits a jump in vain."""
    model, jump = search.extended, _typical_jump(search.extended, search.wheel)
    for manoeuvre in MANOEUVRES:
        if manoeuvre.jump_at is not None and jump == 0:
            continue  # neither records nor wheel file have jumps
        laid_out = _as_problem(search.problem, manoeuvre, search.wheel)
        level = np.full(laid_out.size, float(np.median(model.fit.level)))
        if manoeuvre.jump_at is not None:
            level[int(manoeuvre.jump_at * laid_out.size) :] += jump
        yield manoeuvre, laid_out, level


def _typical_jump(model: Model, wheel: Wheel) -> float:
    """Return the usual size of a jump [N m], from the records, else from the wheel's systems; 0 without either."""
    if model.fit.jumps.size:
        return float(np.median(np.abs(model.fit.level[model.fit.jumps] - model.fit.level[model.fit.jumps - 1])))
    highest = [system.friction[-1] for system in wheel.fss if system.friction is not None]
    return wheel.torque_unit_Nm * float(np.mean([0.5 * (f.low + f.high) for f in highest])) if highest else 0.0


def _separation(laid_out: Problem, torque: FloatArray, alternative: str, level: FloatArray) -> float:
    """Return the residual sum of squares of a torque's best imitation by `alternative` ("": none), over 2σ²."""
    beside = _noiseless(laid_out, torque + level, np.flatnonzero(np.diff(level)) + 1)
    equations = beside.equations_with(*([profile(beside, level, MEAN_EFFECTS[alternative])[0]] if alternative else []))
    return float(equations.rss(equations.solve()[0])) / (2 * laid_out.noise.long_run_variance)


def _noiseless(problem: Problem, z: FloatArray, jumps: IntArray = NO_JUMPS) -> Background:
    """Return the base law for friction without noise; with some viscous drag added, which an imitation may reduce."""
    drag = float(np.max(np.abs(z))) * problem.speed / problem.top_speed
    return Background.of(replace(problem, z=z + drag), (), NoiseLaw(), jumps)


def _expected_torque(search: Search, laid_out: Problem, cause: str, level: FloatArray) -> FloatArray | None:
    """Return s·torque of a cause in the manoeuvre, as strong as found, or as needed to imitate the strongest effect.

    None where the cause cannot imitate that effect.
    """
    problem, model, effect = search.problem, search.extended, MEAN_EFFECTS[cause]
    if cause in model.names:
        index = model.names.index(cause)
        return make_term(laid_out, effect, model.terms[index].shape, level).columns @ model.strengths(index)
    # An alternative: fitted to the torque of the strongest found effect in the recorded data.
    known = model.terms[0].columns @ model.strengths(0)
    fitted, _ = profile(_noiseless(problem, known + model.fit.level.mean()), model.fit.level, effect)
    design = np.column_stack([np.ones(problem.size), problem.speed, fitted.columns])
    strengths = np.clip(np.linalg.lstsq(design, known)[0][2:], fitted.low, fitted.high)
    imitation = fitted.columns @ strengths
    if float(imitation @ imitation) < IMITATION_SHARE * float(known @ known):
        return None
    torque: FloatArray = make_term(laid_out, effect, fitted.shape, level).columns @ strengths
    return torque


def _as_problem(problem: Problem, manoeuvre: Manoeuvre, wheel: Wheel) -> Problem:
    """Return the manoeuvre as a search problem: noise-free motion, zero friction, and the noise model of the record."""
    period = max(wheel.sample_period_s, manoeuvre.duration_s / MAX_SLOTS)
    time_s = np.arange(0.0, manoeuvre.duration_s, period)
    speed = uniform_filter1d(manoeuvre.speed(time_s, problem.top_speed), max(int(RAMP_S / period), 1))
    acceleration, direction = np.gradient(speed, period), np.sign(speed)
    drag = float(np.median(np.abs(problem.z)))
    torque = (wheel.inertia_kg_m2 or 0.0) * acceleration + direction * drag
    channels = Channels(
        time_s=time_s,
        speed_rad_s=speed,
        direction=direction,
        acceleration_rad_s2=acceleration,
        angle_rad=np.cumsum(speed) * period,
        motor_torque_Nm=torque,
        bearing_temperature_degC=20.0 + 0.5 * THERMAL_SWING_K * np.sin(2 * np.pi * time_s / ORBIT_S),
        dry_level_Nm=np.full(time_s.size, drag),
        sample_period_s=period,
        good=np.ones(time_s.size, dtype=bool),
        motor_torque_rate_Nm_s=np.gradient(torque, period),
    )
    used = direction != 0
    record = Record("plan", channels, np.zeros(time_s.size), used, False, 0.0)
    size = int(used.sum())
    return Problem(
        (record,),
        np.zeros(size),
        np.zeros(size),
        0.0,
        np.abs(speed[used]),
        direction[used],
        np.array([0, size]),
        np.flatnonzero(used),
        problem.noise,
        None,
    )


def _steps(
    time_s: FloatArray, speeds: Sequence[float], rate_rad_s2: float, duration_s: float = DURATION_S
) -> FloatArray:
    """Return equal dwells at the given speeds, joined by ramps of the given acceleration."""
    dwell = duration_s / len(speeds)
    ramps = np.clip(np.abs(np.diff(speeds, prepend=speeds[0])) / rate_rad_s2, 1e-3, 0.8 * dwell)
    begins = dwell * np.arange(len(speeds))
    corners = np.stack([begins + ramps, begins + dwell], axis=1)
    return np.asarray(np.interp(time_s, corners.ravel(), np.repeat(speeds, 2)))


MANOEUVRES: Final = (
    Manoeuvre(
        "slow zero crossing",
        "Cross zero speed slowly, from -5 % to +5 % of the top speed and back, in 40 minutes.",
        lambda t, top: 0.05 * top * np.cos(2 * np.pi * t / DURATION_S + 1e-3),
    ),
    Manoeuvre(
        "dwell ladder",
        "Dwell at 1, 2, 4, 8, 16, 32, 64 and 100 % of the top speed, five minutes each.",
        lambda t, top: _steps(t, [top * share for share in (0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.0)], top / 60),
    ),
    Manoeuvre(
        "accelerate and brake, both directions",
        "Ramp up and down at full torque in both directions, with rests of two minutes between.",
        lambda t, top: _steps(t, [top * s for s in (0.6, 0.2, 0.6, 0.2, -0.2, -0.6, -0.2, -0.6, -0.2, 0.2)], top / 40),
    ),
    Manoeuvre(
        "reversals at two accelerations",
        "Reverse the wheel quickly and slowly in turn.",
        lambda t, top: 0.1 * top * np.sin(2 * np.pi * t / np.where(t < DURATION_S / 2, 1200, 150) + 0.1),
    ),
    Manoeuvre(
        "coast-down",
        "Spin up to the top speed and let the wheel coast.",
        lambda t, top: top * np.exp(-t / (DURATION_S / 3)),
    ),
    Manoeuvre(
        "constant speed for an orbit",
        "Hold 60 % of the top speed for an orbit, a thermal cycle of the bearing, then 20 % for another.",
        lambda t, top: _steps(t, [0.6 * top, 0.2 * top], top / 60, 2 * ORBIT_S),
        2 * ORBIT_S,
    ),
    Manoeuvre(
        "same speeds in both directions",
        "Dwell at 30 and 70 % of the top speed, first forwards, then backwards.",
        lambda t, top: _steps(t, [0.3 * top, 0.7 * top, -0.3 * top, -0.7 * top], top / 60),
    ),
    Manoeuvre(
        "two speeds in both directions, across a jump",
        "Dwell at 30 and 70 % of the top speed, forwards and backwards in turn, until the dry friction has jumped, "
        "and then again.",
        lambda t, top: _steps(t, [s * top for s in 2 * (0.3, -0.3, 0.7, -0.7)], top / 60),
        jump_at=0.5,
    ),
    Manoeuvre(
        "steps after different dwells",
        "Step between 30 and 70 % of the top speed after dwells of one, two, four, eight and sixteen minutes.",
        lambda t, top: np.where(np.floor(np.log2(t / 60.0 + 1.0)) % 2 == 0, 0.3 * top, 0.7 * top),
    ),
)


# ---- what to fly next: the questions that a search leaves open, and the manoeuvres that would answer them ------------


CERTAIN: Final = 2 * ACCEPT_GAIN  # an effect that gains so much needs no confirmation
# What would reveal the law of an unexplained torque, by a word of its signature.
SHAPE_SHOWN_BY: Final = (
    (
        "wheel's angle",
        "sample fast while the wheel turns slowly, at two speeds: does the order stay? Compare the bearing's geometry",
    ),
    (
        "periodic",
        "dwell at one speed for ten of its periods or more, then at half that speed: is it time or the angle?",
    ),
    (
        "self-heating",
        "record the bearing's temperature; or hold top speed until the drag settles, then sweep slowly",
    ),
    (
        "since each reversal",
        "reverse, then run for thousands of turns at one speed, at two speeds: does it decay with turns or with time?",
    ),
    ("drift", "hold one speed and temperature for several windows: does it go on, settle, or follow the temperature?"),
    ("wander", "hold one speed and temperature for several windows: does it wander with nothing else changing?"),
    ("temperature", "hold one speed through a thermal cycle, then another speed: does it scale with the speed?"),
    ("dω/dt", "ramp at three accelerations, up and down, in both directions"),
    ("|speed|", "a ladder of dwells around the speeds where it shows, in both directions, up and down"),
)


@dataclass(frozen=True, slots=True)
class Plan:
    """An open question and what would answer it.

    Attributes
    ----------
    question
        What the manoeuvres are ranked by, in words.
    manoeuvres
        Best per unit of time first, without those that separate nothing; empty where none would help.
    advice
        What no manoeuvre of the library answers, in words.
    """

    question: str
    manoeuvres: list[PlannedManoeuvre]
    advice: list[str]


def plan(search: Search) -> Plan:
    """Rank the manoeuvres by how well they would answer the questions that are open.

    First the causes that the data cannot separate; else an effect that is not certain; else, or where no
    manoeuvre would confirm that, the effects that the data could not test.
    """
    advice, left = [], search.result.unexplained
    if left is not None:
        shown = next((words for word, words in SHAPE_SHOWN_BY if word in left.signature), "the same manoeuvre again")
        advice.append(f"{left.signature}, that no effect explains: {shown}")
    mean = [effect for effect in search.result.effects if effect.name in MEAN_EFFECTS]
    sets = [
        [effect.name, *others]
        for effect in mean
        if (others := [name for name in effect.equivalent if name in MEAN_EFFECTS])
    ]
    uncertain = [[effect.name] for effect in mean if effect.delta_deviance < CERTAIN]
    if sets or uncertain:
        causes = (sets or uncertain)[0]
        manoeuvres = _worth_flying(rank_manoeuvres(search, causes))
        question = f"separate {' from '.join(causes)}" if sets else f"confirm {causes[0]}"
        if max((entry.separation for entry in manoeuvres), default=0.0) < DECIDES:
            would = dict.fromkeys(CATALOGUE[name].separate_by for name in causes)
            none = "none of these" if manoeuvres else "no manoeuvre of the library"
            advice.append(f"{none} would {question}; what would: {' '.join(would)}")
        if manoeuvres or sets:
            return Plan(question, manoeuvres, advice)
    # No manoeuvre replaces a channel that is not recorded.
    channels = not_testable(search.problem, search.result.untested)
    missing = {name: what for name, what in search.result.untested if name in MEAN_EFFECTS}
    untested = [name for name in missing if name not in channels]
    for channel in dict.fromkeys(what for name, what in missing.items() if name in channels):
        shown = ", ".join(name for name in missing if name in channels and missing[name] == channel)
        advice.append(f"no manoeuvre shows {shown} without {channel}")
    manoeuvres = _worth_flying(rank_for_untested(search, untested))
    if untested and not manoeuvres:
        advice.append("no manoeuvre of the library would show what these data could not test")
    if not manoeuvres and not advice:
        advice.append("nothing is open that a manoeuvre would answer")
    return Plan("show what these data could not test", manoeuvres, advice)


def _worth_flying(manoeuvres: list[PlannedManoeuvre]) -> list[PlannedManoeuvre]:
    """Return the manoeuvres that separate anything, ordered by effects identified per time, then by nats per time."""
    informative = [entry for entry in manoeuvres if entry.separation >= UNINFORMATIVE]
    return sorted(informative, key=lambda entry: (-len(entry.shows) / entry.duration_s, -entry.nats_per_hour))
