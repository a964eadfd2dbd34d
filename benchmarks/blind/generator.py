"""Blind records: an effect (or none, two, or one outside the catalogue) is hidden in a record drawn from a seed.

The record is what a wheel would send: a table and a wheel.toml that lacks the effect. The truth is kept in a separate
object, to be read after the answer. Strength is the RMS of the part of the effect that is orthogonal to sign,
speed and the true levels, in standard deviations of the noise.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np

from benchmarks.blind import formulas, literature
from benchmarks.blind.formulas import Array, Shape
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.motion import SpeedProfile, simulate_motion
from rwa_monitor.wheel.durations import Uniform
from rwa_monitor.wheel.switching_systems import simulate_system
from rwa_monitor.wheel.torque_balance import derived_noise_variance
from rwa_monitor.wheel.wheel import Derivative, FrictionFilter, FrictionRange, Nominal, SwitchingSystem, Wheel

SAMPLES = 20_000
RELATIVE_NOISE = 0.024  # of the nominal dry torque, as in the paper's errors
MOTION_PERIOD_S = 0.125  # of the wheel for which motions are drawn; other scales follow them faster or slower
DURATION_SCALE = 0.25  # of the built-in wheel's laws, so that 20,000 samples hold some 14 jumps
DURATION_SCALE_SWITCHING = 0.1  # for hidden switching effects, which need many jumps

Manoeuvre = Literal["one_direction", "crossings", "rich"]
NoiseKind = Literal["white", "ar", "student_t"]
Scale = Literal["wheel", "small_wheel", "joint"]

MANOEUVRES: tuple[Manoeuvre, ...] = ("one_direction", "crossings", "rich")
NOISES: tuple[NoiseKind, ...] = ("white", "ar", "student_t")
STRENGTHS = (0.15, 0.5, 1.5)
SCALES: tuple[Scale, ...] = ("wheel", "small_wheel", "joint")

NOISE_EFFECTS = (
    "speed_dependent_noise",
    "coloured_noise",
    "heavy_tailed_noise",
    "tachometer_quantisation",
    "cage_instability",
)
SWITCHING_EFFECTS = (
    "extra_switching_system",
    "wrong_duration_law",
    "decaying_jump",
    "viscous_jump",
    "speed_triggered_jumps",
)
# Effects not identifiable where the direction never changes: the base law fits them, or they act at reversals only.
NEEDS_REVERSALS = frozenset(
    {
        "stribeck",
        "presliding",
        "coulomb_asymmetry",
        "torque_bias",
        "viscous_asymmetry",
        "speed_dead_zone",
    }
)
NEEDS_CURRENT = frozenset(
    {"load_dependence", "torque_constant_error", "torque_constant_temperature", "current_delay"},
)
NEEDS_TEMPERATURE = frozenset({"viscosity_temperature", "torque_constant_temperature"})
# Largest strengths that are physically plausible for an effect; a drawn strength is limited to them. From the
# literature of each effect: 90 % of a level, magnets of 0.3 %/K, delays of two seconds.
LARGEST = {
    "coulomb_asymmetry": 0.3,
    "load_dependence": 0.5,
    "torque_constant_error": 0.3,
    "torque_constant_temperature": 0.003,
    "current_delay": 2.0,
    "decaying_jump": 0.9,
    "viscous_jump": 0.5,
}
ROUNDS = 40  # fixed-point iterations of motor torque and effect; an error of one half is halved that often
# Where friction is derived from the speed, a dead zone reads as rest, and a delay delays the friction as well.
NEEDS_FRICTION = frozenset({"speed_dead_zone"})


@dataclass(frozen=True)
class Case:
    """The plan of a record."""

    seed: int
    effects: tuple[str, ...]
    manoeuvre: Manoeuvre
    noise: NoiseKind
    scale: Scale
    strength: float = 0.5
    friction_given: bool = True
    current: bool = True
    temperature: bool = True
    systems_known: bool = True

    @property
    def kind(self) -> str:
        if not self.effects:
            return "null"
        if len(self.effects) > 1:
            return "two"
        return "outside" if self.effects[0] in formulas.OUTSIDE else "one"


@dataclass(frozen=True)
class Hidden:
    """The truth of a record, read after the answer; arrays over its slots."""

    case: Case
    shapes: dict[str, dict[str, float]]
    torque: dict[str, Array]
    speed: Array
    level: Array
    noise_std: float
    long_run_std: float
    jump_index: np.ndarray[Any, np.dtype[np.int64]]
    visible_jumps: int
    noise_names: tuple[str, ...]  # noise effects present in addition to the hidden ones
    residual: Array = field(repr=False)  # the noise as it was drawn

    def to_json(self) -> dict[str, Any]:
        return {"case": asdict(self.case), "shapes": self.shapes, "visible_jumps": self.visible_jumps}


def plan(kind: str, names: tuple[str, ...], number: int, seed: int) -> Case:
    """Return the plan of the `number`-th record of its kind.

    A Latin square: nine consecutive records have all nine pairs of manoeuvre and noise, and each strength occurs once
    with each manoeuvre and each noise; scale and channels vary with other periods.
    """
    row, column = number % 3, (number // 3) % 3
    square = (row + column + number // 9) % 3
    case = Case(
        seed=int(np.random.SeedSequence([seed, number, *(sum(map(ord, name)) for name in names)]).generate_state(1)[0]),
        effects=names,
        manoeuvre=MANOEUVRES[row],
        noise=NOISES[column],
        strength=STRENGTHS[square],
        scale=SCALES[(number + number // 3) % 3],
        friction_given=number % 3 != (number // 9) % 3,
        current=number % 2 == 0,
        temperature=(number // 2) % 2 == 0,
        systems_known=(number // 4) % 2 == 0,
    )
    return _possible(replace(case, strength=max(case.strength, 0.5)) if kind in ("two", "outside") else case)


def _possible(case: Case) -> Case:
    """Return the case, changed so that its effect is observable: a record without a trace of it tests nothing."""
    names = set(case.effects)
    if names & NEEDS_REVERSALS and case.manoeuvre == "one_direction":
        case = replace(case, manoeuvre="crossings" if case.seed % 2 else "rich")
    if names & NEEDS_FRICTION:
        case = replace(case, friction_given=True)
    if names & {"tachometer_quantisation"}:
        case = replace(case, friction_given=False)
    if names & NEEDS_CURRENT or not case.friction_given:
        case = replace(case, current=True)
    if names & NEEDS_TEMPERATURE:
        case = replace(case, temperature=True)
    if names & set(SWITCHING_EFFECTS):
        case = replace(case, systems_known=True)
    if "coloured_noise" in names or "heavy_tailed_noise" in names:
        case = replace(case, noise="white", friction_given=True)
    return case


# ---- the wheel -------------------------------------------------------------------------------------------------------


def draw_wheel(case: Case, rng: np.random.Generator) -> Wheel:
    """Draw a wheel of the case's scale: its constants vary by a third about those of the scale."""
    vary = np.exp(rng.normal(0.0, 0.3, size=4))
    if case.scale == "joint":
        period, speed, dry, inertia = 0.005, 8.0, 5.0, 2.0
    elif case.scale == "small_wheel":
        period, speed, dry, inertia = 0.1, 600.0, 3.0e-4, 1.0e-3
    else:
        period, speed, dry, inertia = 0.125, 300.0, 1.6e-3, 0.0117
    speed, dry, inertia, viscous = speed * vary[0], dry * vary[1], inertia * vary[2], dry / speed * vary[3]
    scale = DURATION_SCALE_SWITCHING if set(case.effects) & set(SWITCHING_EFFECTS) else DURATION_SCALE

    def law(low: int, high: int) -> Uniform:
        return Uniform(low=max(int(low * scale), 1), high=int(high * scale))

    systems = (
        SwitchingSystem(
            name="fss_1",
            durations=(law(10_000, 20_000), Uniform(low=1, high=200)),
            friction=(FrictionRange(low=0, high=0), FrictionRange(low=0.3, high=0.6)),
        ),
        SwitchingSystem(
            name="fss_2",
            durations=(law(10_000, 30_000),) * 3,
            friction=(
                FrictionRange(low=0, high=0),
                FrictionRange(low=0.4, high=0.6),
                FrictionRange(low=0.8, high=1.2),
            ),
        ),
    )
    central = "tachometer_quantisation" in case.effects and case.seed % 2 == 0
    return Wheel(
        name=f"blind-{case.scale}",
        sample_period_s=period,
        inertia_kg_m2=inertia,
        torque_constant_Nm_A=20.0 * dry,
        nominal=Nominal(dry_torque_Nm=dry, viscous_Nm_s_rad=viscous, nominal_speed_rad_s=speed),
        friction=FrictionFilter(
            derivative=Derivative(method="central" if central else "savitzky_golay", window_s=16 * period)
        ),
        fss=systems,
    )


# ---- the record ------------------------------------------------------------------------------------------------------


def generate(case: Case) -> tuple[Samples, Wheel, Hidden]:
    """Draw the record of a case: samples and wheel, the input of the search, and the truth."""
    rng = np.random.default_rng(case.seed)
    wheel = draw_wheel(case, rng)
    assert wheel.nominal is not None, "drawn with it"
    assert wheel.inertia_kg_m2 is not None, "drawn with it"
    unit = wheel.nominal.dry_torque_Nm
    motion = _motion(case, wheel, rng)
    level, jump_index = _level(case, motion, wheel, rng)
    sign = np.sign(motion.speed)
    base = sign * level + wheel.nominal.viscous_Nm_s_rad * motion.speed
    truth = replace(
        motion,
        level=level,
        motor_torque=base + wheel.inertia_kg_m2 * motion.acceleration,
        jump_index=jump_index,
        jump_size=level[jump_index] - level[jump_index - 1],
        torque_unit=unit,
    )
    std = RELATIVE_NOISE * unit
    noise, names = _noise(case, truth, std, rng)
    speed, speed_std = _tachometer(case, truth, wheel, std, rng)
    total_std, long_run = std, _long_run(case, std)
    if not case.friction_given:
        derived = derived_noise_variance(wheel, speed_std)
        total_std = float(np.hypot(std, np.sqrt(derived)))
    torque, shapes = _effects(case, truth, total_std, rng)
    friction = base + np.sum([*torque.values(), np.zeros(base.size)], axis=0)
    # The current has the noise of the friction, as if the friction were K_T I - J dω/dt of that same current.
    motor = friction + noise + wheel.inertia_kg_m2 * motion.acceleration
    samples = Samples(
        time_ns=np.arange(SAMPLES, dtype=np.int64) * wheel.period_ns,
        speed_rad_s=np.round(speed, 9),
        friction_torque_Nm=friction + noise if case.friction_given else None,
        motor_current_A=motor / wheel.torque_constant_Nm_A if case.current else None,
        bearing_temperature_degC=truth.temperature + rng.normal(0, 0.02, SAMPLES) if case.temperature else None,
    )
    shown = wheel if case.systems_known else wheel.model_copy(update={"fss": ()})
    hidden = Hidden(
        case=case,
        shapes=shapes,
        torque=torque,
        speed=motion.speed,
        level=level,
        noise_std=total_std,
        long_run_std=float(np.hypot(long_run, np.sqrt(max(total_std**2 - std**2, 0.0)))),
        jump_index=jump_index,
        visible_jumps=visible_jumps(level, jump_index, long_run),
        noise_names=names,
        residual=noise,
    )
    return samples, shown, hidden


def _motion(case: Case, wheel: Wheel, rng: np.random.Generator) -> formulas.Truth:
    """Draw a motion at the built-in wheel's sample period and rescale its time to the case's."""
    template = wheel.model_copy(update={"sample_period_s": MOTION_PERIOD_S})
    motion = simulate_motion(SpeedProfile(kind=case.manoeuvre), template, SAMPLES, rng)
    period = wheel.sample_period_s
    speed = motion.speed_rad_s
    time = np.arange(float(SAMPLES)) * period
    angle = np.concatenate([[0.0], np.cumsum(0.5 * period * (speed[1:] + speed[:-1]))])
    # A temperature that swings about 20 °C, 2 to 8 K peak to peak, as over one or two orbits within the record.
    turns = rng.uniform(0.8, 1.8)
    swing = rng.uniform(1.0, 4.0) * np.sin(2 * np.pi * turns * np.arange(SAMPLES) / SAMPLES + rng.uniform(0, 6.28))
    return formulas.Truth(
        time=time,
        speed=speed,
        acceleration=motion.acceleration_rad_s2 * MOTION_PERIOD_S / period,
        angle=angle,
        motor_torque=np.zeros(SAMPLES),
        temperature=20.0 + rng.uniform(-1.0, 1.0) + swing,
        level=np.zeros(SAMPLES),
        period=period,
        speed_unit=float(np.max(np.abs(speed))),
        torque_unit=1.0,
        jump_index=np.zeros(0, dtype=np.int64),
        jump_size=np.zeros(0),
    )


def _level(case: Case, motion: formulas.Truth, wheel: Wheel, rng: np.random.Generator) -> tuple[Array, Any]:
    """Simulate the switching systems, changed as a hidden switching effect asks for."""
    level = np.full(SAMPLES, 1.0)
    clock = np.arange(SAMPLES)
    systems = wheel.fss
    if "speed_triggered_jumps" in case.effects:
        # Log-linear rate, three to five e-folds over the range of the speed, with a mean of one over the record.
        rate = np.exp(rng.choice([-1, 1]) * rng.uniform(3, 5) * np.abs(motion.speed) / motion.speed_unit)
        clock = np.floor(np.cumsum(rate / rate.mean())).astype(np.int64)
    if "wrong_duration_law" in case.effects:
        factor = float(rng.choice([0.3, 0.4, 2.5]))
        changed = []
        for system in systems:
            laws = tuple(
                Uniform(low=max(int(law.low * factor * 0.5), 1), high=max(int(law.high * factor * 1.2), 2))  # type: ignore[union-attr]
                for law in system.durations
            )
            changed.append(system.model_copy(update={"durations": laws}))
        systems = tuple(changed)
    for system in systems:
        level = level + simulate_system(system, int(clock[-1]) + 1, rng).friction[clock]
    if "extra_switching_system" in case.effects:
        level = level + rng.uniform(0.6, 1.0) * _telegraph(rng, rest=900.0, active=400.0)
    jumps = np.flatnonzero(np.diff(level)) + 1
    assert wheel.nominal is not None, "drawn with it"
    return wheel.nominal.dry_torque_Nm * level, jumps


def _telegraph(rng: np.random.Generator, rest: float, active: float) -> Array:
    """Return a random telegraph signal: alternately 0 and about 1, with exponential durations [slots]."""
    out, at, on = np.zeros(SAMPLES), 0, bool(rng.random() < active / (active + rest))
    while at < SAMPLES:
        length = 1 + int(rng.exponential(active if on else rest))
        out[at : at + length] = rng.uniform(0.75, 1.25) if on else 0.0
        at, on = at + length, not on
    return out


def _noise(case: Case, truth: formulas.Truth, std: float, rng: np.random.Generator) -> tuple[Array, tuple[str, ...]]:
    """Draw the noise with any hidden noise effect; return it and the noise effects of the case's own noise."""
    names: list[str] = []
    if case.noise == "student_t":
        noise = std * rng.standard_t(4, SAMPLES) / np.sqrt(2.0)
        names.append("heavy_tailed_noise")
    else:
        noise = std * rng.standard_normal(SAMPLES)
        if case.noise == "ar":
            noise = literature.autoregressive(noise, 0.5)
            names.append("coloured_noise")
    share = np.abs(truth.speed) / truth.speed_unit
    for name in case.effects:
        if name == "coloured_noise":
            noise = literature.autoregressive(noise, float(rng.uniform(0.3, 0.9)))
        elif name == "heavy_tailed_noise":
            nu = float(rng.uniform(3.0, 8.0))
            noise = std * rng.standard_t(nu, SAMPLES) * np.sqrt((nu - 2) / nu)
        elif name == "speed_dependent_noise":
            noise = noise * (1.0 + rng.uniform(0.5, 2.0) * share)
        elif name == "cage_instability":
            at = float(np.quantile(share, rng.uniform(0.3, 0.7)))
            inside = np.abs(share - at) < 0.08
            burst = inside & (_telegraph(rng, rest=150.0, active=150.0) > 0)
            noise = noise * np.where(burst, 1.0 + rng.uniform(1.0, 3.0), 1.0)
            noise = noise + truth.sign * burst * rng.uniform(1.0, 3.0) * std
    return noise, tuple(names)


def _tachometer(
    case: Case, truth: formulas.Truth, wheel: Wheel, std: float, rng: np.random.Generator
) -> tuple[Array, float]:
    """Return the measured speed, and the standard deviation of its error."""
    if "tachometer_quantisation" in case.effects:
        # A step whose differentiated rounding error has one to three times the noise's standard deviation.
        unit = float(np.sqrt(derived_noise_variance(wheel, 1.0)))
        step = float(rng.uniform(1.0, 3.0)) * std / unit * np.sqrt(12.0)
        return step * np.rint(truth.speed / step), step / np.sqrt(12.0)
    assert wheel.nominal is not None, "drawn with it"
    error = wheel.nominal.nominal_speed_rad_s / 30_000.0
    return truth.speed + rng.normal(0, error, SAMPLES), error


def _long_run(case: Case, std: float) -> float:
    return std * float(np.sqrt(3.0)) if case.noise == "ar" else std  # √((1 + φ)/(1 - φ)) with φ = 0.5


def _effects(
    case: Case, truth: formulas.Truth, std: float, rng: np.random.Generator
) -> tuple[dict[str, Array], dict[str, Shape]]:
    """Draw the torques of the hidden effects, scaled to the case's strength."""
    torques: dict[str, Array] = {}
    shapes: dict[str, Shape] = {}
    for name in case.effects:
        shape: Shape = {}
        if name in formulas.OUTSIDE:
            unit = formulas.OUTSIDE[name](truth, rng)
        elif name == "decaying_jump":
            shape = {"time_constant_s": float(rng.uniform(100, 500)) * truth.period}
            unit = literature.relaxing_jumps(
                truth.speed, truth.period, truth.jump_index.tolist(), truth.jump_size, 1.0, shape["time_constant_s"]
            )
        elif name == "viscous_jump":
            unit = literature.jumping_slope(truth.speed, truth.jump_index.tolist(), truth.jump_size, 1.0)
        elif name in formulas.MEAN:
            shape = formulas.draw_shape(name, truth, rng)
            unit = formulas.MEAN[name](truth, shape)
        else:
            continue
        sign = 1.0 if name in formulas.ONE_SIGN or name == "decaying_jump" else float(rng.choice([-1.0, 1.0]))
        size = min(case.strength * std / orthogonal_rms(unit, truth), LARGEST.get(name, np.inf))
        strength = sign * size
        torques[name], shapes[name] = strength * unit, {**shape, "strength": strength}
    return _with_own_motor_torque(torques, shapes, truth), shapes


def _with_own_motor_torque(
    torques: dict[str, Array], shapes: dict[str, Shape], truth: formulas.Truth
) -> dict[str, Array]:
    """Return the torques, those that scale with the motor torque recomputed for the whole motor torque.

    It includes the other effects and, except for a delay of the current, the effect itself: a fixed-point iteration.
    """
    torques = dict(torques)
    for name in [name for name in torques if name in NEEDS_CURRENT for _ in range(ROUNDS)]:
        others = [torque for other, torque in torques.items() if other != name or name != "current_delay"]
        motor = truth.motor_torque + np.sum([*others, np.zeros(truth.speed.size)], axis=0)
        unit = formulas.MEAN[name](replace(truth, motor_torque=motor), shapes[name])
        torques[name] = shapes[name]["strength"] * unit
    return torques


def orthogonal_rms(torque: Array, truth: formulas.Truth) -> float:
    """Return the RMS of the residual of a torque after a fit of sign, speed and the true levels."""
    return float(np.sqrt(np.mean(orthogonal(truth.sign * torque, np.abs(truth.speed), truth.jump_index) ** 2)))


def orthogonal(along: Array, speed: Array, jump_index: Any) -> Array:
    """Return the residual of a torque along the motion after a fit of the slope and of levels between the jumps."""
    segment = np.searchsorted(jump_index, np.arange(along.size), side="right")
    count = np.bincount(segment)

    def centred(values: Array) -> Array:
        return np.asarray(values - (np.bincount(segment, values) / np.maximum(count, 1))[segment])

    a, w = centred(along), centred(speed)
    return np.asarray(a - w * (a @ w) / max(float(w @ w), 1e-300))


def visible_jumps(level: Array, jump_index: Any, long_run_std: float) -> int:
    """Count the jumps that an oracle detects at six standard deviations, given the neighbouring jumps."""
    edges = np.concatenate([[0], jump_index, [level.size]])
    n = np.diff(edges).astype(float)
    size = level[jump_index] - level[jump_index - 1] if len(jump_index) else np.zeros(0)
    information = (size / long_run_std) ** 2 * n[:-1] * n[1:] / (n[:-1] + n[1:])
    return int(np.count_nonzero(information >= 36.0))
