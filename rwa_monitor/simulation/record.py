"""One simulated record: true motion, true friction, the sensors' readings, and the ground truth.

Order of the simulation, as in the wheel: motion → temperature → switching systems → dry and viscous friction → effects
→ noise → motor torque, current and voltage that this motion needs → sensors → faults. Every channel follows from the
same friction, so that K_T·I − J·dω/dt equals it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.random import Generator

from rwa_monitor.errors import InputError
from rwa_monitor.kernels.evidence import SPEED_NOISES
from rwa_monitor.kernels.running_sums import BLOCK
from rwa_monitor.samples import SECONDS_PER_HOUR, BoolArray, FloatArray, IntArray, Samples
from rwa_monitor.simulation.motion import ORBIT_S, ROUNDING, Motion, simulate_motion, wheel_angle
from rwa_monitor.simulation.scenario import Scenario, Temperature
from rwa_monitor.wheel import torque_balance
from rwa_monitor.wheel.effects.base import Channels, Effect, MeanEffect, NoiseEffect, Quantity
from rwa_monitor.wheel.effects.catalogue import build
from rwa_monitor.wheel.effects.switching_base import JumpClock, Jumps, SwitchingEffect
from rwa_monitor.wheel.switching_systems import Realisation, simulate_system
from rwa_monitor.wheel.wheel import Wheel

# A jump counts as visible when an oracle that knows its slot, its neighbours and the slope detects it at six standard
# deviations: λ = (Δ/σ)²·n₁n₂/(n₁+n₂) ≥ 6². A search over 80,000 slots and seven scales (5.6e5 contrasts) with at most
# 0.01 false jumps per window needs a threshold of 5.6 σ; below six, no method with that false-alarm rate can be
# expected to find the jump.
VISIBLE_INFORMATION: Final = 36.0


@dataclass(frozen=True, slots=True)
class Changepoints:
    """The true jumps of all switching systems, sorted by slot; arrays (m,).

    Attributes
    ----------
    index
        int64, first slot of the new level.
    system
        int64, number of the switching system in the wheel file.
    jump_Nm
        Change of dry friction [N m], positive upwards.
    information
        λ = (Δ/σ)²·n₁n₂/(n₁+n₂), n the used samples up to the neighbouring true jumps: the squared signal-to-noise
        ratio of an oracle's contrast.
    visible
        bool, λ ≥ 36 and no other jump on the same slot.
    """

    index: IntArray
    system: IntArray
    jump_Nm: FloatArray
    information: FloatArray
    visible: BoolArray


@dataclass(frozen=True, slots=True)
class Truth:
    """The ground truth of a record of n slots. Slots, not rows: a gap removes rows of the table only.

    Attributes
    ----------
    speed_rad_s, acceleration_rad_s2, bearing_temperature_degC
        float64 (n,), true motion and temperature.
    friction_torque_Nm
        float64 (n,), true friction without noise, effects included.
    noise_Nm
        float64 (n,), noise of the friction torque.
    motor_torque_Nm
        float64 (n,), torque of the motor, noise included; None for a wheel without inertia.
    base_dry_Nm, viscous_Nm_s_rad
        float64 (n,), base dry friction (all systems at rest) and viscous coefficient, anomalies included.
    configuration, fss_friction_Nm
        By system name: int64 (n,) and float64 (n,) [N m].
    effect_torque_Nm
        By effect name, in the order of application: float64 (n,) [N m].
    used
        bool (n,), slots in the table, without fault, |ω| outside the dead band.
    faulty
        bool (n,), slots hit by a declared fault.
    changepoints
        See its class.
    noise_std_Nm, long_run_std_Nm
        Standard deviation of a single friction value, and of a long mean times the root of its length [N m].
    labels
        By anomaly name: whether it is active at the end of the record.
    factors
        By anomaly name: its factor at the end of the record.
    """

    speed_rad_s: FloatArray
    acceleration_rad_s2: FloatArray
    bearing_temperature_degC: FloatArray
    friction_torque_Nm: FloatArray
    noise_Nm: FloatArray
    motor_torque_Nm: FloatArray | None
    base_dry_Nm: FloatArray
    viscous_Nm_s_rad: FloatArray
    configuration: dict[str, IntArray]
    fss_friction_Nm: dict[str, FloatArray]
    effect_torque_Nm: dict[str, FloatArray]
    used: BoolArray
    faulty: BoolArray
    changepoints: Changepoints
    noise_std_Nm: float
    long_run_std_Nm: float
    labels: dict[str, bool]
    factors: dict[str, float]


@dataclass(frozen=True, slots=True)
class Telemetry:
    """A simulated record: the monitor's input, and the ground truth."""

    samples: Samples
    truth: Truth


def true_changepoints(
    systems: list[Realisation], used: BoolArray, torque_unit_Nm: float, long_run_std_Nm: float
) -> Changepoints:
    """Collect the jumps of all systems, with the information in each and whether it is visible."""
    jumps = sorted(
        (slot, number, torque_unit_Nm * jump)
        for number, system in enumerate(systems)
        for slot, jump in zip(system.jump_index.tolist(), system.jump.tolist(), strict=True)
    )
    index, number, jump = np.array(jumps).reshape(-1, 3).T.copy()
    return with_information(index.astype(np.int64), number.astype(np.int64), jump, used, long_run_std_Nm)


def with_information(
    index: IntArray, system: IntArray, jump_Nm: FloatArray, used: BoolArray, long_run_std_Nm: float
) -> Changepoints:
    """Return the jumps, sorted by slot, with an oracle's information on each; `used` has the length of the record."""
    real = jump_Nm != 0.0
    places, times = np.unique(index[real], return_counts=True)
    used_before = np.concatenate([[0], np.cumsum(used)])
    between = np.diff(used_before[np.concatenate([[0], places, [used.size]])]).astype(np.float64)
    left, right = between[:-1], between[1:]
    samples = left * right / np.maximum(left + right, 1.0)
    at = np.searchsorted(places, index[real])
    information = np.zeros(index.size)
    with np.errstate(divide="ignore", invalid="ignore"):  # without noise, each jump between samples is visible
        ratio = np.square(jump_Nm[real] / long_run_std_Nm)
        information[real] = np.where(samples[at] > 0.0, samples[at] * ratio, 0.0)
    alone = np.zeros(index.size, dtype=np.bool_)
    alone[real] = times[at] == 1
    return Changepoints(index, system, jump_Nm, information, alone & (information >= VISIBLE_INFORMATION))


def cut(telemetry: Telemetry, start: int, stop: int, wheel: Wheel) -> Telemetry:
    """Return the slots [start, stop) of a record as a record, with the information and visibility of its jumps in it.

    Labels and factors are kept as they are: the caller sets those of the piece.
    """
    truth = telemetry.truth

    def of_piece(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: of_piece(one) for name, one in value.items()}
        return value[start:stop] if isinstance(value, np.ndarray) else value

    piece = {field.name: of_piece(getattr(truth, field.name)) for field in fields(Truth)}
    jumps = truth.changepoints
    inside = (jumps.index > start) & (jumps.index < stop)
    index, system, jump_Nm = jumps.index[inside] - start, jumps.system[inside], jumps.jump_Nm[inside]
    piece["changepoints"] = with_information(index, system, jump_Nm, piece["used"], truth.long_run_std_Nm)
    time_ns = telemetry.samples.time_ns
    rows = slice(*np.searchsorted(time_ns, time_ns[0] + np.array([start, stop]) * wheel.period_ns))
    return Telemetry(telemetry.samples[rows], Truth(**piece))


ROTOR_TIME_CONSTANT_S: Final = 1200.0  # s, bearing against housing: tens of minutes for a wheel of a few kilograms
DISSIPATION_K_W: Final = 2.0  # K/W, bearing above the housing per watt of friction
ORBITAL_SWING_K: Final = (1.0, 5.0)  # K, peak to peak over an orbit; a working assumption
COUPLING_ROUNDS: Final = 100  # at most, of effects that depend on the motor torque that they add to
BUS_VOLTAGE_V: Final = 28.0  # V, a regulated bus (ECSS-E-ST-20C); nothing in a simulated wheel depends on it
STANDBY_W: Final = 3.0  # W, power of the drive's electronics; a working assumption
QUANTUM_STD: Final = 12.0**-0.5  # of the rounding error, in steps: uniform over one step


def simulate(scenario: Scenario, wheel: Wheel, rng: Generator) -> Telemetry:
    """Simulate one record of a wheel.

    Each part draws from a random stream of its own, so that a change in one (another noise, one fault more) leaves the
    others unchanged; the same generator state gives the same bytes.

    Parameters
    ----------
    scenario
        Motion, anomalies, noise, sensors and faults.
    wheel
        Its constants, nominal friction, switching systems and effects apply.
    rng
        Source of all randomness.

    Returns
    -------
    Telemetry
        Samples and truth.

    Raises
    ------
    InputError
        If the scenario needs a constant or system that the wheel lacks.
    """
    scenario.check(wheel)
    slots = scenario.slots(wheel)
    streams = _Streams(*rng.spawn(len(_Streams._fields)))
    motion = simulate_motion(scenario.speed, wheel, slots, streams.motion)
    parts = _friction_parts(scenario, wheel, motion, streams)
    noise, noise_std, long_run_std = _friction_noise(scenario, wheel, parts, streams)
    torque = parts.friction + noise  # y: the friction that exact sensors of speed and current give
    motor = _motor_torque(wheel, torque, motion)
    samples = _measure(scenario, wheel, parts, torque, motor, streams.sensors)
    samples, faulty, missing = _apply_faults(scenario, wheel, samples, streams.faults)
    used = _used(scenario, wheel, samples, faulty)
    end_s = np.array(slots * wheel.sample_period_s)
    factors = {name: float(scenario.factor_at(name, end_s)) for name in wheel.anomalies}
    truth = Truth(
        speed_rad_s=motion.speed_rad_s,
        acceleration_rad_s2=motion.acceleration_rad_s2,
        bearing_temperature_degC=parts.temperature,
        friction_torque_Nm=parts.friction,
        noise_Nm=noise,
        motor_torque_Nm=motor,
        base_dry_Nm=parts.base_dry,
        viscous_Nm_s_rad=parts.viscous,
        configuration={name: system.configuration for name, system in parts.systems.items()},
        fss_friction_Nm={name: wheel.torque_unit_Nm * system.friction for name, system in parts.systems.items()},
        effect_torque_Nm=parts.effect_torque,
        used=used,
        faulty=faulty,
        changepoints=true_changepoints(list(parts.systems.values()), used, wheel.torque_unit_Nm, long_run_std),
        noise_std_Nm=noise_std,
        long_run_std_Nm=long_run_std,
        labels={name: factor != 1.0 for name, factor in factors.items()},
        factors=factors,
    )
    return Telemetry(samples[~missing], truth)


class _Streams(NamedTuple):
    """One generator for each part of the simulation."""

    motion: Generator
    temperature: Generator
    systems: Generator
    extra_systems: Generator
    effects: Generator
    noise: Generator
    sensors: Generator
    faults: Generator
    drift: Generator


class _Parts(NamedTuple):
    """The friction and its components; arrays (n,) as in Truth, `channels` is the input of the effects."""

    channels: Channels
    temperature: FloatArray
    base_dry: FloatArray
    viscous: FloatArray
    systems: dict[str, Realisation]
    effects: tuple[Effect, ...]
    effect_torque: dict[str, FloatArray]
    friction: FloatArray


def _friction_parts(scenario: Scenario, wheel: Wheel, motion: Motion, streams: _Streams) -> _Parts:
    """Return the sum of base dry and viscous friction, switching systems and effects, with its components."""
    assert wheel.nominal is not None
    nominal_dry, nominal_viscous = wheel.nominal.dry_torque_Nm, wheel.nominal.viscous_Nm_s_rad
    speed, slots = motion.speed_rad_s, motion.speed_rad_s.size
    time = np.arange(slots, dtype=np.float64) * wheel.sample_period_s
    direction = np.sign(speed)
    dry = nominal_dry * scenario.base.dry * scenario.factor_at("dry", time)
    if (drift := scenario.base.dry_drift_per_sqrt_h) > 0.0:
        step = drift * np.sqrt(wheel.sample_period_s / SECONDS_PER_HOUR)
        dry += nominal_dry * np.cumsum(step * streams.drift.standard_normal(slots))
    viscous = nominal_viscous * scenario.base.viscous * scenario.factor_at("viscous", time)
    # Heat of the base friction only: switching systems may depend on the temperature, so it must not depend on them.
    power = np.abs(speed) * (dry + viscous * np.abs(speed))
    temperature = bearing_temperature(time, power, streams.temperature, scenario.temperature)
    channels = Channels(
        time_s=time,
        speed_rad_s=speed,
        direction=direction,
        acceleration_rad_s2=motion.acceleration_rad_s2,
        angle_rad=wheel_angle(speed, wheel.sample_period_s),
        bearing_temperature_degC=temperature,
        sample_period_s=wheel.sample_period_s,
        good=np.ones(slots, dtype=np.bool_),
    )
    effects = tuple(build(block) for block in (*wheel.effect, *scenario.effect))
    switching = [effect for effect in effects if isinstance(effect, SwitchingEffect)]
    systems = _systems(scenario, wheel, channels, switching, streams)
    level = dry.copy()
    for realisation in systems.values():
        level += nominal_dry * realisation.friction
    friction = direction * level + viscous * speed

    effect_torque: dict[str, FloatArray] = {}
    jumps = _jumps_of(systems, nominal_dry)
    for effect in switching:
        torque = effect.torque(channels, jumps)
        if torque.any():
            effect_torque[effect.name] = torque
            friction = friction + torque
    channels = replace(channels, motor_torque_Nm=_motor_torque(wheel, friction, motion), dry_level_Nm=level)
    acting = [effect for effect in _acting(scenario, effects) if isinstance(effect, MeanEffect)]
    coupled = couple(acting, channels, viscous / nominal_viscous if nominal_viscous > 0.0 else 1.0)
    for torque in coupled.values():
        friction = friction + torque
    return _Parts(channels, temperature, dry, viscous, systems, effects, {**effect_torque, **coupled}, friction)


def _systems(
    scenario: Scenario, wheel: Wheel, channels: Channels, effects: list[SwitchingEffect], streams: _Streams
) -> dict[str, Realisation]:
    """Simulate the wheel's switching systems as changed by the switching effects, and the levels that effects add."""
    clocks = [clock for effect in effects if (clock := effect.clock(channels)) is not None]
    clock = clocks[0] if clocks else JumpClock(np.arange(len(channels)))
    systems: dict[str, Realisation] = {}
    for system, stream in zip(wheel.fss, streams.systems.spawn(len(wheel.fss)), strict=True):
        for effect in effects:
            system = effect.change_system(system)

        def factor(slot: int, name: str = system.name) -> float:
            return float(scenario.factor_at(name, np.array(clock.slot_in_record(slot) * wheel.sample_period_s)))

        systems[system.name] = clock.read(simulate_system(system, clock.slots, stream, factor))
    for effect, stream in zip(effects, streams.extra_systems.spawn(len(effects)), strict=True):
        level = effect.extra_level(channels, stream)
        if level.any():
            jump_index = (np.flatnonzero(np.diff(level)) + 1).astype(np.int64)
            # A level whose rest is zero: configuration 1 where it is not zero.
            configuration = (level != 0.0).astype(np.int64)
            systems[effect.name] = Realisation(configuration, level / wheel.torque_unit_Nm, jump_index)
    return systems


def _jumps_of(systems: dict[str, Realisation], torque_unit_Nm: float) -> Jumps:
    """Return the jumps of the level, with those on the same slot added up."""
    index = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(s.jump_index for s in systems.values())]))
    size = np.zeros(index.size)
    for system in systems.values():
        size[np.searchsorted(index, system.jump_index)] += torque_unit_Nm * system.jump
    return Jumps(index, size)


def _motor_torque(wheel: Wheel, friction: FloatArray, motion: Motion) -> FloatArray | None:
    """Return the motor torque that motion and friction require, or None for a wheel without inertia."""
    if wheel.inertia_kg_m2 is None:
        return None
    return wheel.inertia_kg_m2 * motion.acceleration_rad_s2 + friction


def couple(
    effects: list[MeanEffect], channels: Channels, viscous_share: FloatArray | float = 1.0
) -> dict[str, FloatArray]:
    """Return the torque of every mean effect, by name, consistent with the motor torque that they themselves require.

    Friction that depends on the motor torque (a load, a wrong torque constant) changes the motor torque in turn. The
    loop friction → motor torque → friction is a contraction as long as the effects return less than the whole motor
    torque; it is repeated to convergence. The rate of the motor torque is that without effects: a delayed current is
    not delayed twice. An effect that is a share of the viscous friction is computed for the nominal one and multiplied
    by `viscous_share`, float64 (n,) or a number.

    Raises
    ------
    InputError
        If the loop does not converge.
    """
    plain = channels.motor_torque_Nm
    if plain is not None:
        channels = replace(channels, motor_torque_rate_Nm_s=np.gradient(plain, channels.sample_period_s))
    coupled = plain is not None and any("motor_torque_Nm" in effect.needs for effect in effects)
    torques: list[FloatArray] = []
    for _ in range(COUPLING_ROUNDS if coupled else 1):
        torques = [
            effect.torque(channels)[0] * (viscous_share if effect.scales_with_viscous else 1.0) for effect in effects
        ]
        if plain is None or not coupled:
            break
        motor = plain + np.sum(torques, axis=0)
        change = float(np.max(np.abs(motor - channels.motor_torque_Nm)))
        channels = replace(channels, motor_torque_Nm=motor)
        if change <= ROUNDING * float(np.max(np.abs(motor))):
            break
    else:
        raise InputError(
            "scenario", "its effects feed the motor torque back so strongly that no torque balances", "effect"
        )
    named: dict[str, FloatArray] = {}
    for effect, torque in zip(effects, torques, strict=True):
        named[effect.name] = named[effect.name] + torque if effect.name in named else torque
    return named


def _friction_noise(
    scenario: Scenario, wheel: Wheel, parts: _Parts, streams: _Streams
) -> tuple[FloatArray, float, float]:
    """Draw the noise of the friction torque; return it with its standard deviation, and that of a long mean [N m].

    Where friction is given, the wheel's noise includes all errors of its estimate. Where it is not, speed and current
    have their own noise, and the friction itself has noise only if the scenario states it, or has a noise effect.
    """
    shaping = [effect for effect in _acting(scenario, parts.effects) if isinstance(effect, NoiseEffect)]
    std = scenario.noise.std_Nm
    if std is None:
        std = (wheel.noise.friction_std_Nm or 0.0) if scenario.friction_given or shaping else 0.0
    values = scenario.noise.draw(std, len(parts.channels), streams.noise)
    long_run = scenario.noise.long_run_std(std)
    for effect, stream in zip(shaping, streams.effects.spawn(len(shaping)), strict=True):
        values = effect.apply(values, parts.channels, stream)
    if shaping:
        std, long_run = float(np.std(values)), _long_run_std(values)
    if scenario.friction_given:
        return values, std, long_run
    sensors = scenario.sensors.for_wheel(wheel)
    speed = np.hypot(sensors["speed_noise_rad_s"], sensors["speed_quantum_rad_s"] * QUANTUM_STD)
    true = parts.channels.speed_rad_s
    for tachometer in parts.effects:
        if isinstance(tachometer, NoiseEffect) and tachometer.is_of_tachometer:
            speed = np.std(tachometer.read_speed(true) - true)
    current = np.hypot(sensors["current_noise_A"], sensors["current_quantum_A"] * QUANTUM_STD)
    derived = torque_balance.derived_noise_variance(wheel, float(speed), float(current))
    return values, math.sqrt(std**2 + derived), math.sqrt(long_run**2 + derived)


def _acting(scenario: Scenario, effects: Sequence[Effect]) -> list[Effect]:
    """Return the effects that change friction or its noise.

    Effects of the tachometer change only a friction that was computed with its speed and is given, not the current
    from which friction is yet to be derived.
    """
    return [effect for effect in effects if scenario.friction_given or not effect.is_of_tachometer]


def _read_speed(effects: Sequence[Effect], true: FloatArray, measured: FloatArray) -> FloatArray:
    """Return the tachometer's reading [rad/s], float64 (n,); where it is quantised, that replaces the usual noise."""
    of_tachometer = [effect for effect in effects if effect.is_of_tachometer]
    for effect in sorted(of_tachometer, key=lambda effect: not isinstance(effect, NoiseEffect)):
        measured = effect.read_speed(true if isinstance(effect, NoiseEffect) else measured)
    return measured


def _long_run_std(noise: FloatArray) -> float:
    """Return the standard deviation of block means times the root of the block's length [N m]."""
    blocks = noise[: noise.size - noise.size % BLOCK].reshape(-1, BLOCK)
    if len(blocks) < 2:
        return float(np.std(noise))
    return float(np.sqrt(BLOCK) * np.std(np.mean(blocks, axis=1)))


def _measure(
    scenario: Scenario, wheel: Wheel, parts: _Parts, torque: FloatArray, motor: FloatArray | None, rng: Generator
) -> Samples:
    """Return the sensors' readings, one row for each slot."""
    sensors = scenario.sensors.for_wheel(wheel)
    # A random stream for each channel: leaving one out changes none of the others.
    speed_rng, current_rng, voltage_rng, temperature_rng, bus_rng, power_rng, momentum_rng = rng.spawn(7)
    true = parts.channels.speed_rad_s
    speed = measure(true, sensors["speed_noise_rad_s"], sensors["speed_quantum_rad_s"], speed_rng)
    channels: dict[str, Any] = {
        "speed_rad_s": _read_speed(parts.effects, true, speed),
        "bearing_temperature_degC": measure(parts.temperature, sensors["temperature_noise_K"], 0.0, temperature_rng),
    }
    on_request = {
        "angle_rad": parts.channels.angle_rad,
        "bus_voltage_V": measure(np.full(true.size, BUS_VOLTAGE_V), sensors["voltage_noise_V"], 0.0, bus_rng),
    }
    if scenario.friction_given:
        channels["friction_torque_Nm"] = quantised(torque, sensors["friction_quantum_Nm"])
    if motor is not None and wheel.torque_constant_Nm_A is not None:
        per_ampere = torque_balance.torque_per_ampere(motor, true, wheel)
        current = motor / per_ampere
        measured = measure(current, sensors["current_noise_A"], sensors["current_quantum_A"], current_rng)
        measured[np.abs(measured) < (wheel.limits.min_current_A or 0.0)] = 0.0
        channels["motor_current_A"] = measured
        on_request["motor_torque_Nm"] = per_ampere * measured
        if wheel.winding_resistance_ohm is not None and wheel.back_emf_constant_V_s_rad is not None:
            per_speed = (1.0 - _error_of("torque constant", parts.effects)) * wheel.back_emf_constant_V_s_rad
            voltage = wheel.winding_resistance_ohm * current + per_speed * (wheel.gear_ratio or 1.0) * true
            channels["motor_voltage_V"] = measure(voltage, sensors["voltage_noise_V"], 0.0, voltage_rng)
            power = STANDBY_W + voltage * current
            on_request["drive_power_W"] = measure(power, sensors["power_noise_W"], 0.0, power_rng)
    if wheel.inertia_kg_m2 is not None:
        momentum = -(wheel.inertia_kg_m2 + _error_of("inertia", parts.effects)) * true
        on_request["body_momentum_Nms"] = measure(momentum, sensors["momentum_noise_Nms"], 0.0, momentum_rng)
    if scenario.channels is not None:
        channels |= on_request
        if name := next((one for one in scenario.channels if one not in channels), ""):
            raise InputError("scenario", f"{name} is not given, or the wheel lacks constants for it", "channels")
        channels = {name: channels[name] for name in ("speed_rad_s", *scenario.channels)}
    time_ns = scenario.start_ns + np.arange(true.size, dtype=np.int64) * wheel.period_ns
    return Samples(time_ns=time_ns, **channels)


def _error_of(quantity: Quantity, effects: Sequence[Effect]) -> float:
    """Return by how much the effects make a constant of the wheel wrong, as its effect of the catalogue states it."""
    return sum(next(iter(effect.values.values())) for effect in effects if effect.error_of == quantity)


def measure(true: FloatArray, noise_std: float, quantum: float, rng: Generator) -> FloatArray:
    """Return a sensor's reading, float64 (n,): the truth plus white noise, rounded to the quantum."""
    return quantised(true + noise_std * rng.standard_normal(true.size), quantum)


def quantised(values: FloatArray, quantum: float) -> FloatArray:
    """Return values rounded to multiples of a quantum; unchanged where it is zero."""
    return quantum * np.rint(values / quantum) if quantum > 0.0 else values


def bearing_temperature(
    time_s: FloatArray, friction_power_W: FloatArray, rng: Generator, given: Temperature | None = None
) -> FloatArray:
    """Return the bearing's temperature [°C], float64 (n,): orbital swing of the housing, with lag, plus dissipation.

    Parameters
    ----------
    time_s
        Time of each slot [s].
    friction_power_W
        Friction torque times speed [W], float64 (n,).
    rng
        Source of all randomness: mean temperature, amplitude and phase of the swing.
    given
        Mean and amplitude where the scenario states them.
    """
    base = rng.uniform(15.0, 25.0)  # °C, usual for a wheel inside the spacecraft
    swing = 0.5 * rng.uniform(*ORBITAL_SWING_K)
    if given is not None:
        base, swing = given.mean_degC, given.swing_K
    rate = 2.0 * np.pi / ORBIT_S
    lag = np.arctan(rate * ROTOR_TIME_CONSTANT_S)  # of a first-order body behind its housing
    housing: FloatArray = base + swing * np.sin(rate * time_s + rng.uniform(0, 2 * np.pi) - lag)
    from scipy import signal

    # Exact step of the first-order lag for a power constant over a slot; the record begins in equilibrium.
    stay = float(np.exp(-(time_s[1] - time_s[0]) / ROTOR_TIME_CONSTANT_S))
    target = DISSIPATION_K_W * friction_power_W
    warm, _ = signal.lfilter([1.0 - stay], [1.0, -stay], target, zi=[stay * float(np.mean(target))])
    return housing + warm


def _apply_faults(
    scenario: Scenario, wheel: Wheel, samples: Samples, rng: Generator
) -> tuple[Samples, BoolArray, BoolArray]:
    """Return the samples with all declared faults, which slots are faulty, and which are missing from the table."""
    faulty = np.zeros(len(samples), dtype=np.bool_)
    missing = np.zeros(len(samples), dtype=np.bool_)
    for fault, stream in zip(scenario.fault, rng.spawn(len(scenario.fault)), strict=True):
        hit = fault.slots_hit(len(samples), wheel.sample_period_s, stream)
        faulty |= hit
        if fault.kind == "gap":
            missing |= hit
            continue
        values = getattr(samples, fault.channel)
        if values is None:
            raise InputError("scenario", f"the record has no {fault.channel}", "fault.channel")
        changed: dict[str, Any] = {fault.channel: fault.apply(values, hit, stream)}
        samples = replace(samples, **changed)
    return samples, faulty, missing


def _used(scenario: Scenario, wheel: Wheel, samples: Samples, faulty: BoolArray) -> BoolArray:
    """Return bool (n,), the slots that a diagnosis can use."""
    if (dead_band := wheel.window.dead_band_rad_s) is None:
        dead_band = SPEED_NOISES * scenario.sensors.for_wheel(wheel)["speed_noise_rad_s"]
    speed = np.where(faulty, np.nan, samples.speed_rad_s)
    used = ~faulty & (np.abs(speed) > dead_band)
    if not scenario.friction_given:
        used &= np.isfinite(torque_balance.differentiate(speed, wheel.friction.derivative, wheel.sample_period_s))
    return used
