"""Trials of the model check at a window's close with an effect that the model lacks, and of the diagnosis then.

A trial hides one effect in a few windows of a wheel of recipe `paper`, at a strength that is the RMS of its part
orthogonal to sign, speed and true levels (`strength.py`), in standard deviations of the noise, over all
slots of the first window, the dead band included. The windows are consecutive; the state is carried over.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks.adequacy.strength import level_columns, strength_for
from benchmarks.window import Window
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.diagnosis.window import diagnose_window
from rwa_monitor.errors import InputError
from rwa_monitor.messages import Diagnosis
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.samples import BoolArray
from rwa_monitor.simulation.datasets import MILD_SEVERITIES, RECIPES
from rwa_monitor.simulation.motion import ProfileKind, SpeedProfile
from rwa_monitor.simulation.record import Truth, simulate
from rwa_monitor.simulation.scenario import Anomaly, Scenario
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.effects import catalogue
from rwa_monitor.wheel.effects.base import Channels, MeanEffect
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, to_block
from rwa_monitor.wheel.wheel import EffectBlock, Wheel

MOTIONS: Final[tuple[ProfileKind, ...]] = ("one_direction", "crossings", "rich", "orbit")
# An effect's place decides what is drawn for it: those that take another's place, added later, come last.
MEAN_EFFECTS: Final = tuple(
    sorted(
        catalogue.MEAN_EFFECTS,
        key=lambda name: bool(catalogue.MEAN_EFFECTS[name].superseded_by),
    )
)
WINDOW_SLOTS: Final = 80_000  # of the paper
SHAPE_SPREAD: Final = 2.0  # shape parameters are drawn within this factor of the catalogue's typical value

Job = tuple[str, ProfileKind, int, float, str]  # effect, motion, seed, sigmas, anomaly ("" for none)
Diagnosed = tuple[str, Diagnosis, frozenset[str]]  # recipe, diagnosis, the window's anomalies


@dataclass(frozen=True, slots=True)
class Trial:
    """One hidden effect on one motion.

    Attributes
    ----------
    effect, motion
        Their names.
    sigmas
        Strength of the effect.
    windows
        Diagnoses of the windows in order; empty where the effect cannot have this strength on the motion.
    """

    effect: str
    motion: ProfileKind
    sigmas: float
    windows: tuple[Diagnosis, ...]

    def seen_within(self, count: int) -> bool:
        """Return whether the model is called inadequate in any of the first `count` windows."""
        return any(not diagnosis.model_adequate for diagnosis in self.windows[:count])


def hide_and_diagnose(
    name: str,
    motion: ProfileKind,
    seed: int,
    *,
    sigmas: float = 0.5,
    windows: int = 3,
    anomalies: Mapping[str, Anomaly] | None = None,
    slots: int = WINDOW_SLOTS,
) -> Trial:
    """Hide an effect in windows of a wheel whose model lacks it, and diagnose them.

    Parameters
    ----------
    name, motion
        Effect of the catalogue, and motion of the wheel.
    seed
        Of all random draws, which are the same with and without anomalies and at any strength.
    sigmas
        Strength.
    windows
        Number of windows, each with its own motion.
    anomalies
        Anomalies of the wheel.
    slots
        Length of a window.
    """
    rng = np.random.default_rng([seed, MEAN_EFFECTS.index(name), MOTIONS.index(motion)])
    wheel = RECIPES["paper"].wheel(rng)
    seeds = rng.integers(2**63, size=windows)
    plain = Scenario(speed=SpeedProfile(kind=motion), duration_s=slots * wheel.sample_period_s)
    try:
        block = _draw(name, plain, wheel, int(seeds[0]), sigmas, rng)
    except InputError:
        return Trial(name, motion, sigmas, ())
    scenario = plain.model_copy(update={"effect": (block,), "anomalies": dict(anomalies or {})})
    diagnoses, carried = [], CarriedState.empty()
    for each in seeds:
        diagnosis, carried = _diagnose(scenario, wheel, int(each), carried)
        diagnoses.append(diagnosis)
    return Trial(name, motion, sigmas, tuple(diagnoses))


def diagnose_plain(motion: ProfileKind, seed: int, slots: int) -> Diagnosis:
    """Diagnose one window of `slots` slots of a healthy wheel of recipe `paper` whose model is complete."""
    rng = np.random.default_rng([seed, MOTIONS.index(motion), slots])
    wheel = RECIPES["paper"].wheel(rng)
    scenario = Scenario(speed=SpeedProfile(kind=motion), duration_s=slots * wheel.sample_period_s)
    return _diagnose(scenario, wheel, int(rng.integers(2**63)), CarriedState.empty())[0]


def _diagnose(scenario: Scenario, wheel: Wheel, seed: int, carried: CarriedState) -> tuple[Diagnosis, CarriedState]:
    samples = simulate(scenario, wheel, np.random.default_rng(seed)).samples
    evidence = Window.of(samples, wheel).evidence()
    diagnosis, _, carried = diagnose_window(evidence, wheel, built_in_model(), carried)
    return diagnosis, carried


def _draw(
    name: str, without: Scenario, wheel: Wheel, seed: int, sigmas: float, rng: np.random.Generator
) -> EffectBlock:
    """Draw shape and strength of an effect; InputError where it is not observable on the motion."""
    plain = simulate(without, wheel, np.random.default_rng(seed))
    channels = true_channels(plain.truth, wheel, ~plain.truth.faulty)
    effect = CATALOGUE[name]
    assert issubclass(effect, MeanEffect)
    shape = _draw_shape(effect, channels, rng)
    levels = level_columns(channels.direction, np.unique(plain.truth.changepoints.index))
    strengths = strength_for(effect, shape, channels, levels, sigmas * plain.truth.noise_std_Nm, rng)
    return to_block(effect(**shape, **strengths))


def true_channels(truth: Truth, wheel: Wheel, good: BoolArray) -> Channels:
    """Return the true motion of a record, without noise, as input of effects: to scale those to be hidden in it.

    Parameters
    ----------
    truth
        Of the record.
    wheel
        Its wheel.
    good
        bool (n,), slots that count: `~truth.faulty` with the dead band.
    """
    speed, period = truth.speed_rad_s, wheel.sample_period_s
    motor = None if truth.motor_torque_Nm is None else truth.motor_torque_Nm - truth.noise_Nm
    return Channels(
        time_s=np.arange(speed.size, dtype=np.float64) * period,
        speed_rad_s=speed,
        direction=np.sign(speed),
        acceleration_rad_s2=truth.acceleration_rad_s2,
        angle_rad=np.concatenate([[0.0], np.cumsum(0.5 * period * (speed[1:] + speed[:-1]))]),
        motor_torque_Nm=motor,
        bearing_temperature_degC=truth.bearing_temperature_degC,
        dry_level_Nm=truth.base_dry_Nm + np.sum(list(truth.fss_friction_Nm.values()), axis=0),
        sample_period_s=period,
        good=good,
        motor_torque_rate_Nm_s=None if motor is None else np.gradient(motor, period),
    )


def _draw_shape(effect: type[MeanEffect], channels: Channels, rng: np.random.Generator) -> dict[str, float]:
    """Draw shape parameters about their typical values, within the range that the motion resolves."""
    bounds = effect.shape_bounds(channels)
    shape = {}
    for parameter in effect.shape_parameters():
        factor = SHAPE_SPREAD ** rng.uniform(-1.0, 1.0)
        if parameter.choices:
            shape[parameter.name] = float(rng.choice(parameter.choices))
        else:
            shape[parameter.name] = float(np.clip(parameter.typical * factor, *bounds[parameter.name]))
    return shape


def diagnose_recipe(recipe: str, number: int, seed: int, *, nominal: bool) -> tuple[Diagnosis, frozenset[str]]:
    """Diagnose one window of a recipe with a complete model; also return the window's anomalies.

    Parameters
    ----------
    recipe, number, seed
        As in `simulation.datasets.generate`.
    nominal
        Leave out the anomalies that the recipe draws.
    """
    rng = np.random.default_rng([seed, number])
    wheel = RECIPES[recipe].wheel(rng)
    scenario = RECIPES[recipe].scenario(wheel, number, 1, rng)
    if nominal:
        scenario = scenario.model_copy(update={"anomalies": {}})
    telemetry = simulate(scenario, wheel, rng)
    (closed,) = diagnose_samples(telemetry.samples, wheel, built_in_model())
    return closed.diagnosis, frozenset(name for name, active in telemetry.truth.labels.items() if active)


# ---- for a pool of processes: one argument each ----------------------------------------------------------------------


def seen(job: tuple[str, ProfileKind, int]) -> Trial:
    """Run one trial of the detection table."""
    name, motion, seed = job
    return hide_and_diagnose(name, motion, seed)


def judged(job: Job) -> Trial:
    """Run one trial of the diagnosis table: a single window."""
    name, motion, seed, sigmas, anomaly = job
    anomalies = {anomaly: Anomaly(factor=MILD_SEVERITIES[anomaly])} if anomaly else None
    return hide_and_diagnose(name, motion, seed, sigmas=sigmas, windows=1, anomalies=anomalies)


def lacking_nothing(job: tuple[str, int, int, bool]) -> Diagnosed:
    """Diagnose one window of a recipe."""
    recipe, number, seed, nominal = job
    return recipe, *diagnose_recipe(recipe, number, seed, nominal=nominal)


def seen_in_short(job: tuple[str, ProfileKind, int, float, int]) -> Trial:
    """Run one trial of the table of shorter windows: a single window."""
    name, motion, seed, sigmas, slots = job
    return hide_and_diagnose(name, motion, seed, sigmas=sigmas, windows=1, slots=slots)


def plain_and_short(job: tuple[ProfileKind, int, int]) -> bool:
    """Return whether the model is called adequate in a short window where it is complete."""
    motion, seed, slots = job
    return diagnose_plain(motion, seed, slots).model_adequate
