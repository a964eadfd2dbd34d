"""Labelled windows by recipe, on which the classifiers are trained and every figure of the benchmark is measured.

A recipe draws a wheel (duration laws), then a scenario (healthy friction, motion, anomalies), then simulates it. All
randomness comes from one seed; the i-th record of a dataset depends on the seed and on i only, not on the number of
records.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, Final

import numpy as np
from numpy.random import Generator

from rwa_monitor.errors import InputError, did_you_mean
from rwa_monitor.simulation.motion import ProfileKind, SpeedProfile
from rwa_monitor.simulation.record import Telemetry, cut, simulate
from rwa_monitor.simulation.scenario import Anomaly, Base, Fault, FrictionNoise, Scenario, Sensors, Temperature
from rwa_monitor.wheel.durations import DurationLaw, Geometric, Histogram, Lognormal, Uniform, Weibull
from rwa_monitor.wheel.effects.drag_laws import SEASON_K
from rwa_monitor.wheel.wheel import EffectBlock, FrictionRange, SwitchingSystem, Wheel, built_in_wheel

# Severities: the factor of each anomaly on the nominal value (dry and viscous coefficients, friction of a system).
# `mild` is given by the project's issue. Those of `paper` were searched once and fixed where the paper's method comes
# near the paper's figures, about 95 % detection of each anomaly and false positives of about 3 % (docs/benchmark.md).
MILD_SEVERITIES: Final = {"dry": 1.30, "viscous": 1.15, "fss_1": 1.6, "fss_2": 1.4}
HARD_SEVERITIES: Final = {**MILD_SEVERITIES, "fss_3": 1.6}
PAPER_SEVERITIES: Final = {"dry": 2.2, "viscous": 1.12, "fss_1": 1.8, "fss_2": 2.2}

# Healthy wheels differ from their wheel file's historical averages: preload and lubricant fill vary from unit to unit,
# and a degree of temperature changes viscous friction by some per cent (−2…−8 %/K). A wheel's averages are
# its own, so only the drift since they were taken remains: 3 % of dry and 2 % of viscous friction (standard
# deviations, a working assumption), truncated at three of them so that no healthy wheel is anomalous by a rare draw.
BASE_DRY_STD: Final = 0.03
BASE_VISCOUS_STD: Final = 0.02
BASE_CUT: Final = 3.0  # standard deviations

# The paper counts 26 ± 10 changepoints per window of 80,000; Examples 1 and 2 alone give 14.6. The factor on a wheel's
# rate of jumps (one over that on its durations) is uniform between these two; mean and standard deviation of the count
# then equal the paper's (tests/simulation/test_datasets.py measures them).
PAPER_JUMP_RATE: Final = (0.63, 2.93)

HARD_JUMP_SIGMAS: Final = (3.0, 6.0)  # jumps of `hard` in standard deviations of the noise
HARD_GAPS: Final = (1, 4)  # gaps per window, both included
HARD_GAP_S: Final = (1.0, 60.0)  # s: a lost packet to a short outage
HARD_ANOMALY_SHARE: Final = 0.25  # probability of each anomaly, independently
FLEET_WINDOWS: Final = 24  # windows in the life of one wheel
FLEET_ONSET: Final = (0.1, 0.5)  # share of that life after which its anomaly begins to grow
FLEET_SEVERITIES: Final = {name: 1.0 + 1.5 * (mild - 1.0) for name, mild in MILD_SEVERITIES.items()}  # at its end
LABEL_SHARE: Final = 0.5  # a growing anomaly counts as active from half of its final severity on


# A bearing in orbit: ±3 K with the eclipses, ±15 K over the seasons, measured by a sensor on the housing; viscosity
# falls by 2 to 8 % per kelvin (the catalogue's range). All but the latter are working assumptions.
ORBIT_SWING_K: Final = 3.0
ACTIVATION_K: Final = (1700.0, 6900.0)
SENSOR_LAG_S: Final = (300.0, 1200.0)  # s, tens of minutes at most for a wheel of a few kilograms
# `flown`: noise as measured on six joints of a robot at 200 Hz (docs/measured.md: correlation of neighbours 0.56 to
# 0.98 in the residual of the fitted law, spread up to three times larger at speed, 3.5 to 12 degrees of freedom),
# converted to the wheel's own period. Quanta are those of 13 to 16 bits over twice the maximum current. No available
# record is long enough to measure a drift over hours: that, and the sizes of the anomalies, are working assumptions.
# Durations and jumps are those of `paper`: public reports of flown wheels state no sizes, and times only of what lasts
# longer than a window: FUSE, "a week or two" of raised friction before a stop (status report 104, 2007); Cassini, a
# wheel that was normal again within two days (December 2000); Kepler's wheel 4, raised from January to May 2013.
FLOWN_CORRELATION_TIME_S: Final = (0.0086, 0.25)  # s, of an AR(1) with that correlation
FLOWN_TAILS: Final = (3.5, 12.0)  # degrees of freedom
FLOWN_SPREAD: Final = (1.0, 3.0)  # of the noise at nominal speed over that at rest
FLOWN_BITS: Final = (13, 16)  # of the current's converter, both included
FLOWN_DRIFT_PER_SQRT_H: Final = (0.0, 0.01)  # of base dry friction
FLOWN_EXCESS: Final = {"dry": (0.06, 0.50), "viscous": (0.03, 0.25), "fss_1": (0.3, 1.5), "fss_2": (0.2, 1.2)}


@dataclass(frozen=True, slots=True)
class LabelledWindow:
    """One window of a dataset.

    Attributes
    ----------
    name
        Name of the record, unique in its dataset; records of one wheel share a prefix.
    wheel
        The wheel as its wheel.toml states: laws, nominal values.
    scenario
        The scenario that was simulated.
    telemetry
        Samples and truth.
    """

    name: str
    wheel: Wheel
    scenario: Scenario
    telemetry: Telemetry

    @property
    def labels(self) -> dict[str, bool]:
        """By anomaly name: whether it is active."""
        return self.telemetry.truth.labels

    @property
    def status(self) -> str:
        """The status in words: "nominal", or the active anomalies joined by "+"."""
        return "+".join(name for name, active in self.labels.items() if active) or "nominal"


# Wheel, its number, windows of its life, generator → its scenario.
DrawScenario = Callable[[Wheel, int, int, Generator], Scenario]


@dataclass(frozen=True, slots=True)
class Recipe:
    """How the records of a dataset are generated.

    Attributes
    ----------
    name
        The argument of `simulate dataset --recipe`.
    wheel
        Draws a wheel.
    scenario
        Draws a wheel's scenario, given its number, by which statuses alternate, and the windows of its life.
    windows
        Windows in the life of one wheel, which follow each other in time; each is a record of its own.
    """

    name: str
    wheel: Callable[[Generator], Wheel]
    scenario: DrawScenario
    windows: int = 1


def generate(recipe: str | Recipe, count: int, seed: int) -> Iterator[LabelledWindow]:
    """Generate the windows of a dataset, one by one.

    Parameters
    ----------
    recipe
        A recipe, or the name of one of `RECIPES`.
    count
        Number of windows.
    seed
        Seed of all randomness; not negative.

    Yields
    ------
    LabelledWindow
        In order; the windows of one wheel follow each other.

    Raises
    ------
    InputError
        If the recipe is unknown, or a number is negative.
    """
    if isinstance(recipe, str):
        if recipe not in RECIPES:
            hint = did_you_mean(recipe, RECIPES)
            raise InputError("recipe", f"{recipe!r} is none of {', '.join(RECIPES)}{hint}")
        recipe = RECIPES[recipe]
    if count < 0 or seed < 0:
        raise InputError("recipe", f"count {count}, seed {seed}: none may be negative")
    for number in range(-(-count // recipe.windows)):
        yield from islice(wheel_windows(recipe, number, seed), count - number * recipe.windows)


def wheel_windows(recipe: str | Recipe, number: int, seed: int) -> Iterator[LabelledWindow]:
    """Generate the windows in the life of the `number`-th wheel of a dataset, cut from one record; see `generate`."""
    recipe = RECIPES[recipe] if isinstance(recipe, str) else recipe
    life = recipe.windows
    rng = np.random.default_rng([seed, number])
    wheel = recipe.wheel(rng).model_copy(update={"name": f"{recipe.name}_{number:05d}"})
    scenario = recipe.scenario(wheel, number, life, rng)
    record = simulate(scenario, wheel, rng)
    if life == 1:
        yield LabelledWindow(wheel.name, wheel, scenario, record)
        return
    samples = wheel.window.samples
    for window in range(life):
        piece = cut(record, window * samples, (window + 1) * samples, wheel)
        middle_s = np.array((window + 0.5) * samples * wheel.sample_period_s)
        factors = {name: float(scenario.factor_at(name, middle_s)) for name in wheel.anomalies}
        grown = {name for name, anomaly in scenario.anomalies.items() if anomaly.share_at(middle_s) >= LABEL_SHARE}
        labels = {name: name in grown for name in wheel.anomalies}
        piece = replace(piece, truth=replace(piece.truth, labels=labels, factors=factors))
        yield LabelledWindow(f"{wheel.name}_{window:03d}", wheel, scenario, piece)


# ---- wheels ----------------------------------------------------------------------------------------------------------


def scaled_law(law: DurationLaw, factor: float) -> DurationLaw:
    """Return a duration law with all durations multiplied by `factor`, in whole slots of at least 1."""
    if isinstance(law, Uniform):
        low = max(1, round(law.low * factor))
        return Uniform(low=low, high=max(low, round(law.high * factor)))
    if isinstance(law, Geometric):
        return Geometric(mean_slots=max(1.0, law.mean_slots * factor))
    if isinstance(law, Weibull):
        return Weibull(shape=law.shape, scale=law.scale * factor)
    if isinstance(law, Lognormal):
        return Lognormal(mu=law.mu + float(np.log(factor)), sigma=law.sigma)
    edges = [max(1, round(law.edges[0] * factor))]
    for edge in law.edges[1:]:
        edges.append(max(edges[-1] + 1, round(edge * factor)))
    return Histogram(edges=tuple(edges), weights=law.weights)


def scaled_wheel(wheel: Wheel, factor: float) -> Wheel:
    """Return a wheel whose switching systems are slower by `factor`."""
    systems = tuple(
        system.model_copy(update={"durations": tuple(scaled_law(law, factor) for law in system.durations)})
        for system in wheel.fss
    )
    return wheel.model_copy(update={"fss": systems})


def _example_wheel(rng: Generator) -> Wheel:
    """Return a wheel with the systems of the paper's Examples 1 and 2, with a random rate of jumps."""
    return _with_random_rate(built_in_wheel(), rng)


def _with_random_rate(wheel: Wheel, rng: Generator) -> Wheel:
    return scaled_wheel(wheel, 1.0 / rng.uniform(*PAPER_JUMP_RATE))


def _hard_wheel(rng: Generator) -> Wheel:
    """Return a wheel of three systems with small jumps and various kinds of duration laws."""
    wheel = built_in_wheel()
    assert wheel.nominal is not None
    assert wheel.noise.friction_std_Nm is not None
    sigma = wheel.noise.friction_std_Nm / wheel.nominal.dry_torque_Nm
    low, high = (sigma * jump for jump in HARD_JUMP_SIGMAS)
    middle = 0.5 * (low + high)
    rest, active = FrictionRange(low=0.0, high=0.0), FrictionRange(low=low, high=high)
    # The third configuration of fss_2 lies so that each of its steps is a jump of 3–6 σ, too.
    steps = FrictionRange(low=low, high=middle), FrictionRange(low=middle + low, high=high + low)
    slow = Uniform(low=10_000, high=30_000)
    bursts = Weibull(shape=1.5, scale=20_000.0), Lognormal(mu=float(np.log(3_000.0)), sigma=0.5)
    systems = (
        SwitchingSystem(
            name="fss_1",
            durations=(Uniform(low=10_000, high=20_000), Uniform(low=200, high=1_000)),
            friction=(rest, active),
        ),
        SwitchingSystem(name="fss_2", durations=(slow, slow, slow), friction=(rest, *steps)),
        SwitchingSystem(name="fss_3", durations=bursts, friction=(rest, active)),
    )
    return _with_random_rate(wheel.model_copy(update={"fss": systems}), rng)


def _heated_wheel(rng: Generator) -> Wheel:
    """Return an example wheel whose viscosity depends on the temperature, with a sensor that the bearing lags."""
    wheel = _example_wheel(rng)
    assert wheel.nominal is not None
    law = EffectBlock(
        name="viscosity_temperature",
        parameters={
            "strength_Nm_s_rad": wheel.nominal.viscous_Nm_s_rad,
            "activation_temperature_K": rng.uniform(*ACTIVATION_K),
            "sensor_lag_s": rng.uniform(*SENSOR_LAG_S),
        },
    )
    return wheel.model_copy(update={"effect": (law,)})


# ---- scenarios -------------------------------------------------------------------------------------------------------


def _life(
    wheel: Wheel,
    windows: int,
    kinds: tuple[ProfileKind, ...],
    rng: Generator,
    drift_per_sqrt_h: tuple[float, float] | None = None,
    **more: Any,
) -> Scenario:
    """Return the scenario of a wheel in its healthy scatter, with one of the motions, and a drift within a range."""
    dry, viscous = np.clip(rng.standard_normal(2), -BASE_CUT, BASE_CUT)
    drift = rng.uniform(*drift_per_sqrt_h) if drift_per_sqrt_h else 0.0
    return Scenario(
        duration_s=windows * wheel.window_s,
        base=Base(dry=1.0 + BASE_DRY_STD * dry, viscous=1.0 + BASE_VISCOUS_STD * viscous, dry_drift_per_sqrt_h=drift),
        speed=SpeedProfile(kind=kinds[rng.integers(len(kinds))]),
        **more,
    )


def _one_status(severities: Mapping[str, float], wheel: Wheel, number: int) -> dict[str, Anomaly]:
    """Return no anomaly or one of them, in turn by number, so that every status is equally frequent."""
    status = (None, *wheel.anomalies)[number % (1 + len(wheel.anomalies))]
    return {} if status is None else {status: Anomaly(factor=severities[status])}


def _one_anomaly(severities: Mapping[str, float], **more: Any) -> DrawScenario:
    """Return the scenario of a wheel with at most one anomaly, in one direction of rotation or in both."""

    def scenario(wheel: Wheel, number: int, windows: int, rng: Generator) -> Scenario:
        anomalies = _one_status(severities, wheel, number)
        return _life(wheel, windows, ("orbit", "one_direction"), rng, anomalies=anomalies, **more)

    return scenario


def _fleet(wheel: Wheel, number: int, windows: int, rng: Generator) -> Scenario:
    """Return a long life in which the anomaly begins at a random time and grows to the end."""
    scenario = _one_anomaly(FLEET_SEVERITIES)(wheel, number, windows, rng)
    onset = scenario.duration_s * rng.uniform(*FLEET_ONSET)
    growing = {
        name: anomaly.model_copy(update={"onset_s": onset, "growth_s": scenario.duration_s - onset})
        for name, anomaly in scenario.anomalies.items()
    }
    return scenario.model_copy(update={"anomalies": growing})


def _hard(wheel: Wheel, number: int, windows: int, rng: Generator) -> Scenario:  # noqa: ARG001
    """Return any combination of anomalies, with autocorrelated noise, zero crossings and gaps."""
    active = rng.random(len(wheel.anomalies)) < HARD_ANOMALY_SHARE
    return _life(
        wheel,
        windows,
        ("orbit", "crossings", "rich"),
        rng,
        fault=_gaps(wheel, windows, rng),
        anomalies={
            name: Anomaly(factor=HARD_SEVERITIES[name]) for name, on in zip(wheel.anomalies, active, strict=True) if on
        },
        noise=FrictionNoise(law="ar1"),
    )


def _orbit(wheel: Wheel, number: int, windows: int, rng: Generator) -> Scenario:
    """Return a scenario as of `mild`, with a bearing that warms and cools over the orbit and the year."""
    mild = _one_anomaly(MILD_SEVERITIES)(wheel, number, windows, rng)
    mean_degC = Temperature().mean_degC + SEASON_K * rng.uniform(-1.0, 1.0)
    return mild.model_copy(update={"temperature": Temperature(mean_degC=mean_degC, swing_K=ORBIT_SWING_K)})


def _gaps(wheel: Wheel, windows: int, rng: Generator) -> tuple[Fault, ...]:
    """Draw the gaps of every window."""
    return tuple(
        Fault(kind="gap", start_s=(window + rng.random()) * wheel.window_s, duration_s=rng.uniform(*HARD_GAP_S))
        for window in range(windows)
        for _ in range(rng.integers(*HARD_GAPS, endpoint=True))
    )


def _flown(wheel: Wheel, number: int, windows: int, rng: Generator) -> Scenario:
    """Return at most one anomaly of random size, with noise, quanta, drift and gaps drawn for each wheel."""
    assert wheel.nominal is not None
    excess = {name: 1.0 + rng.uniform(*bounds) for name, bounds in FLOWN_EXCESS.items()}
    correlation_time_s = float(np.exp(rng.uniform(*np.log(FLOWN_CORRELATION_TIME_S))))
    spread = rng.uniform(*FLOWN_SPREAD) - 1.0
    current_A = 2.0 * (wheel.limits.max_current_A or 0.0) * 2.0 ** -float(rng.integers(*FLOWN_BITS, endpoint=True))
    scenario = _life(
        wheel,
        windows,
        ("orbit", "one_direction", "crossings", "rich"),
        rng,
        drift_per_sqrt_h=FLOWN_DRIFT_PER_SQRT_H,
        anomalies=_one_status(excess, wheel, number),
        noise=FrictionNoise(law="ar1", ar_coefficient=float(np.exp(-wheel.sample_period_s / correlation_time_s))),
        sensors=Sensors(friction_quantum_Nm=current_A * (wheel.torque_constant_Nm_A or 0.0)),
    )
    growth_s_rad = spread / wheel.nominal.nominal_speed_rad_s
    effects = (
        EffectBlock(name="heavy_tailed_noise", parameters={"degrees_of_freedom": rng.uniform(*FLOWN_TAILS)}),
        EffectBlock(name="speed_dependent_noise", parameters={"strength_s_rad": growth_s_rad}),
    )
    return scenario.model_copy(update={"effect": effects, "fault": _gaps(wheel, windows, rng)})


RECIPES: Final[Mapping[str, Recipe]] = {
    recipe.name: recipe
    for recipe in (
        # The paper's statistics: 26 ± 10 changepoints, at most one anomaly, severities of its figures.
        Recipe("paper", _example_wheel, _one_anomaly(PAPER_SEVERITIES)),
        # The same with dry +30 %, viscous +15 %, fss_1 ×1.6, fss_2 ×1.4.
        Recipe("mild", _example_wheel, _one_anomaly(MILD_SEVERITIES)),
        # Any combination of anomalies, jumps of 3–6 σ, AR(1) noise, zero crossings, three systems, gaps.
        Recipe("hard", _hard_wheel, _hard),
        # Noise, quanta and gaps as measured, a slow drift, anomalies of any size.
        Recipe("flown", _example_wheel, _flown),
        # As mild, with friction only from noisy speed and current.
        Recipe("derived", _example_wheel, _one_anomaly(MILD_SEVERITIES, friction_given=False)),
        # As mild, viscosity −2…−8 %/K, ±3 K an orbit and ±15 K over the year, bearing lagging its sensor.
        Recipe("orbit", _heated_wheel, _orbit),
        # Many windows of each wheel, an anomaly that grows slowly.
        Recipe("fleet", _example_wheel, _fleet, windows=FLEET_WINDOWS),
    )
}


# ---- output ----------------------------------------------------------------------------------------------------------


def truth_document(window: LabelledWindow) -> dict[str, Any]:
    """Return the truth about a window as a JSON document, without the per-slot arrays.

    Returns
    -------
    dict
        `record`, `wheel`, `status`, `labels`, `factors` (by anomaly), `slots`, `used` (slots), `noise_std_Nm`,
        `changepoints` [{index, fss, jump_Nm, information, visible}], `components` {base_dry_Nm, viscous_Nm_s_rad
        (means over the window), fss: {name: {start_index, configuration, friction_Nm}} (one entry per sojourn),
        effect_rms_Nm: {name: RMS}}, and `scenario` as in its file.
    """
    truth, jumps = window.telemetry.truth, window.telemetry.truth.changepoints
    systems = {}
    for number, (name, configuration) in enumerate(truth.configuration.items()):
        starts = np.concatenate([[0], jumps.index[jumps.system == number]]).astype(np.int64)
        systems[name] = {
            "start_index": starts.tolist(),
            "configuration": configuration[starts].tolist(),
            "friction_Nm": truth.fss_friction_Nm[name][starts].tolist(),
        }
    names = list(systems)
    columns = (jumps.index, jumps.system, jumps.jump_Nm, jumps.information, jumps.visible)
    return {
        "record": window.name,
        "wheel": window.wheel.name,
        "status": window.status,
        "labels": dict(window.labels),
        "factors": dict(truth.factors),
        "slots": int(truth.used.size),
        "used": int(truth.used.sum()),
        "noise_std_Nm": truth.noise_std_Nm,
        "changepoints": [
            {
                "index": index,
                "fss": names[system],
                "jump_Nm": jump,
                "information": information if np.isfinite(information) else None,  # None: without noise
                "visible": visible,
            }
            for index, system, jump, information, visible in zip(*(c.tolist() for c in columns), strict=True)
        ],
        "components": {
            "base_dry_Nm": float(np.mean(truth.base_dry_Nm)),
            "viscous_Nm_s_rad": float(np.mean(truth.viscous_Nm_s_rad)),
            "fss": systems,
            "effect_rms_Nm": {
                name: float(np.sqrt(np.mean(np.square(torque)))) for name, torque in truth.effect_torque_Nm.items()
            },
        },
        "scenario": window.scenario.to_tables(),
    }
