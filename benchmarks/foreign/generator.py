"""Simulates friction records from the physics alone, with numpy on a fine time grid; it imports nothing of the package.

A wheel of inertia J is driven along a speed ω(t); its current follows from `K_T I = J dω/dt + friction`. Speed and
current are computed on a grid of `FINE` steps per sample, then delayed, averaged over the sample (or taken in its
middle), given noise and rounded. The friction column, if present, is `K_T I - J dω/dt` by the nominal constants.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Law = tuple[str, float, float]  # a family of sojourn laws [samples] and its parameters; a geometric law has one
Sojourns = list[tuple[int, int, int]]  # configuration, first sample, length

FINE: Final = 10  # steps of the fine grid per sample


@dataclass(frozen=True, slots=True)
class Plant:
    """One wheel: inertia [kg m²], K_T [N m/A], dry [N m], viscous [N m s/rad], speeds [rad/s], noises, period [s]."""

    inertia: float
    torque_constant: float
    dry: float
    viscous: float
    top_speed: float
    top_acceleration: float
    period: float
    noise: float  # of the friction [N m]
    speed_noise: float
    current_noise: float
    given: bool  # whether the table has a friction column
    averaged: bool  # whether sensors average over the sample, or take its middle

    @property
    def full_scale(self) -> float:
        """Full-scale torque of the motor [N m]."""
        return self.inertia * self.top_acceleration + 3.0 * self.dry

    def sampled(self, value: Array) -> Array:
        """Return the readings of a noiseless sensor from values on the fine grid."""
        steps = value.reshape(-1, FINE)
        weights = np.full(FINE, 1.0 / FINE) if self.averaged else np.eye(FINE)[FINE // 2]
        return np.asarray(steps @ weights)


@dataclass(frozen=True, slots=True)
class System:
    """A switching system: laws of the sojourns and range of friction [of the dry torque] by configuration."""

    name: str
    laws: tuple[Law, ...]
    friction: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class World:
    """A wheel in motion on the fine grid: speed, acceleration, dry level, temperatures [K about 20 °C]."""

    plant: Plant
    speed: Array
    acceleration: Array
    level: Array
    bearing: Array
    housing: Array  # where the sensor sits
    jumps: NDArray[np.int64]  # samples
    sojourns: tuple[Sojourns, ...]  # of each system

    @property
    def step(self) -> float:
        """Step of the fine grid [s]."""
        return self.plant.period / FINE

    @property
    def time(self) -> Array:
        """Time on the fine grid [s]."""
        return np.arange(self.speed.size, dtype=np.float64) * self.step

    @property
    def side(self) -> Array:
        """Sign of the speed."""
        return np.sign(self.speed)

    @property
    def share(self) -> Array:
        """Absolute speed as a share of the top speed."""
        return np.abs(self.speed) / self.plant.top_speed

    @property
    def samples(self) -> int:
        """Number of samples."""
        return self.speed.size // FINE


@dataclass(frozen=True, slots=True)
class Hidden:
    """One effect: its name, its size in the unit of `draws.SIZES`, and the shape that was drawn."""

    name: str
    size: float
    shape: dict[str, float] = field(default_factory=dict)

    def __getitem__(self, name: str) -> float:
        return self.shape[name]


# ---- wheel and motion ------------------------------------------------------------------------------------------------


def draw_plant(rng: np.random.Generator, given: bool) -> Plant:
    """Draw a wheel of a size between a nanosatellite's and a large space telescope's."""
    inertia = 10.0 ** rng.uniform(-4.0, -1.0)
    top = rng.uniform(350.0, 750.0)
    dry = float(1.5e-3 * np.sqrt(inertia / 0.01) * np.exp(0.3 * rng.standard_normal()))
    noise = float(dry * np.exp(rng.uniform(np.log(0.012), np.log(0.04))))
    period = float(rng.choice((0.2, 0.25, 0.5, 1.0)))
    acceleration = top / rng.uniform(80.0, 400.0)
    constant = inertia * acceleration / rng.uniform(0.5, 2.0)
    # Where friction is derived, the derivative of the speed has as much noise as the current.
    speed_noise = top * 10.0 ** rng.uniform(-5.5, -4.2) if given else noise * period / inertia
    return Plant(
        inertia, constant, dry, dry * rng.uniform(0.5, 2.0) / top, top, acceleration, period, noise,
        speed_noise, 0.7 * noise / constant, given, bool(rng.integers(2)),
    )  # fmt: skip


def _phase(plant: Plant, start: float, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Return legs (duration [s], speed at the end) of one phase of the motion, of a random kind."""
    top, rate = 0.9 * plant.top_speed, 0.8 * plant.top_acceleration
    side = float(rng.choice((-1.0, 1.0)))
    legs: list[tuple[float, float]] = [(0.0, start)]

    def go(speed: float, pace: float, dwell: float = 1.0) -> None:
        legs.append((max(abs(speed - legs[-1][1]) / pace, 1.0), speed))
        legs.append((dwell, speed))

    kind = rng.choice(("reversals", "trapezoids", "orbit", "dump", "ladder"))
    if kind == "reversals":
        for _ in range(4):
            pace = float(np.exp(rng.uniform(np.log(0.02), np.log(rate))))
            height = min(top, pace * rng.uniform(60.0, 200.0))
            go(side * height, rate)
            for turn in (-side, side, -side):
                go(turn * height, pace)
    elif kind == "trapezoids":
        for _ in range(rng.integers(5, 10)):
            go(rng.uniform(-top, top), rate * rng.uniform(0.1, 1.0), rng.uniform(20.0, 200.0))
    elif kind == "orbit":
        middle, swing, cycle = rng.uniform(-0.3, 0.3) * top, rng.uniform(0.1, 0.6) * top, rng.uniform(1500.0, 6000.0)
        go(middle, rate * 0.5)
        legs += [(cycle / 60.0, middle + swing * np.sin(2.0 * np.pi * k / 60.0)) for k in range(1, 91)]
    elif kind == "dump":
        go(side * rng.uniform(0.1, 0.5) * top, rate)
        go(side * rng.uniform(0.6, 1.0) * top, rate * rng.uniform(0.02, 0.1))
        go(-side * rng.uniform(0.1, 0.4) * top, rate * rng.uniform(0.5, 1.0), rng.uniform(30.0, 200.0))
    else:
        for height in (0.003, 0.01, 0.03, 0.1, 0.25, 0.5, 0.9):
            go(side * height * top, rate * rng.uniform(0.2, 0.6), rng.uniform(30.0, 80.0))
        go(-side * 0.05 * top, rate * 0.5)
    return legs[1:]


def draw_motion(plant: Plant, samples: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return speed and acceleration on the fine grid: consecutive phases, corners with finite jerk, some jitter."""
    times, speeds = [0.0], [rng.uniform(-0.5, 0.5) * plant.top_speed]
    while times[-1] < samples * plant.period:
        for duration, speed in _phase(plant, speeds[-1], rng):
            times.append(times[-1] + duration)
            speeds.append(speed)
    step = plant.period / FINE
    rate = np.diff(np.interp(np.arange(samples * FINE + 1) * step, times, speeds)) / step
    rate += 1e-3 * plant.top_acceleration * np.repeat(rng.standard_normal(samples), FINE)
    width = max(int(rng.uniform(0.5, 4.0) / step), 2)
    rate = np.convolve(rate, np.full(width, 1.0 / width), "same")
    return speeds[0] + np.cumsum(rate) * step - 0.5 * rate * step, rate


def relax(course: Array, seconds: float, step: float) -> Array:
    """Return the first-order lag of a signal, with a time constant [s]."""
    keep, now, out = float(np.exp(-step / seconds)), float(course[0]), []
    for value in course.tolist():
        now = value + keep * (now - value)
        out.append(now)
    return np.array(out)


# ---- switching systems -----------------------------------------------------------------------------------------------


def sojourn(law: Law, rng: np.random.Generator) -> float:
    """Draw the length of a sojourn [samples]."""
    family, a, b = law
    if family == "uniform":
        drawn = float(rng.integers(int(a), int(b) + 1))
    elif family == "weibull":
        drawn = float(np.rint(b * rng.weibull(a)))
    elif family == "lognormal":
        drawn = float(np.rint(rng.lognormal(a, b)))
    else:
        drawn = float(rng.geometric(1.0 / a))
    return max(drawn, 1.0)


def draw_path(
    system: System, samples: int, rng: np.random.Generator, clock: Array | None = None
) -> tuple[Array, Sojourns]:
    """Simulate a system: friction per sample [of the dry torque] and sojourns, shorter where `clock` is faster."""
    ticks = np.concatenate(([0.0], np.cumsum(np.ones(samples) if clock is None else clock)))
    friction, sojourns = np.zeros(samples), []
    at, now, rest = 0, int(rng.integers(len(system.laws))), rng.uniform()  # the first sojourn began before the record
    while at < samples:
        length = max(sojourn(system.laws[now], rng) * rest, 1.0)
        end = min(max(int(np.searchsorted(ticks, ticks[at] + length)), at + 1), samples)
        friction[at:end] = rng.uniform(*system.friction[now])
        sojourns.append((now, at, end - at))
        ways = [q for q in (now - 1, now + 1) if 0 <= q < len(system.laws)]
        at, now, rest = end, ways[int(rng.integers(len(ways)))], 1.0
    return friction, sojourns


def draw_world(
    plant: Plant,
    systems: Sequence[System],
    samples: int,
    rng: np.random.Generator,
    clock: Callable[[Array], Array | None] = lambda _: None,
) -> World:
    """Simulate motion, temperatures and levels; jumps lie anywhere in a sample, at rates of `clock` of the speed."""
    speed, rate = draw_motion(plant, samples, rng)
    ticks = clock(np.abs(speed[FINE // 2 :: FINE]) / plant.top_speed)
    paths = [draw_path(system, samples, rng, ticks) for system in systems]
    total = 1.0 + sum((friction for friction, _ in paths), np.zeros(samples))
    level = plant.dry * np.roll(np.repeat(total, FINE), int(rng.integers(FINE)))
    time = np.arange(speed.size) * plant.period / FINE
    housing = rng.uniform(1.0, 5.0) * np.sin(2.0 * np.pi * (time / rng.uniform(3000.0, 6000.0) + rng.uniform()))
    housing += rng.uniform(-8.0, 8.0) * (1.0 - 2.0 * np.exp(-3.0 * time / time[-1]))
    bearing = relax(housing, rng.uniform(60.0, 600.0), plant.period / FINE)
    jumps = np.flatnonzero(np.diff(total)) + 1
    return World(plant, speed, rate, level, bearing, housing, jumps, tuple(of for _, of in paths))


# ---- effects in the friction: torque [N m] on the fine grid ----------------------------------------------------------


def _bristle(world: World, angle: float) -> Array:
    """Deflection z / z_c of Dahl's bristle, by the exact solution for a constant speed over each step."""
    side, now, out = world.side, float(world.side[0]), []
    keeps = np.exp(-np.abs(world.speed) * world.step / angle)
    for keep, end in zip(keeps.tolist(), side.tolist(), strict=True):
        now = end + keep * (now - end)
        out.append(now)
    return np.array(out)


def _viscosity(world: World, effect: Hidden) -> Array:
    """Change of the viscous torque by Arrhenius's law; `size` is the relative change per kelvin at 293 K."""
    kelvin = 293.0 + world.bearing
    return world.plant.viscous * world.speed * np.expm1(effect.size * 293.0 * (1.0 - 293.0 / kelvin))


def _ripple(world: World, effect: Hidden) -> Array:
    angle = effect["order"] * np.cumsum(world.speed) * world.step
    return effect.size * world.plant.dry * (np.sin(angle) + effect["second"] * np.sin(2.0 * angle + 1.0))


def _pockets(world: World, effect: Hidden) -> Array:
    """Drag that jumps and relaxes: a share of the systems' jumps or, with `alone`, oil pockets at other times."""
    if not effect["alone"]:
        relaxed = world.level[0] - relax(world.level, effect["seconds"], world.step)
        return np.asarray(effect.size * relaxed * world.side)
    out, time, rng = np.zeros(world.speed.size), world.time, np.random.default_rng(int(effect["seed"]))
    for begin in rng.uniform(0.03, 0.9, int(effect["events"])) * time[-1]:
        after = time >= begin
        out[after] += rng.uniform(0.7, 1.3) * np.exp(-(time[after] - begin) / effect["seconds"])
    return effect.size * world.plant.dry * out * world.side


def _switched(world: World, effect: Hidden, low: float, high: float) -> Array:
    """Alternately 0 and 1 on the fine grid, with durations uniform between two shares of the record."""
    law = ("uniform", max(np.rint(low * world.samples), 2.0), np.rint(high * world.samples))
    system = System("", (law, law), ((0.0, 0.0), (1.0, 1.0)))
    return np.repeat(draw_path(system, world.samples, np.random.default_rng(int(effect["seed"])))[0], FINE)


def _slopes(world: World, effect: Hidden) -> Array:
    """Torque of a viscous coefficient that jumps with the dry level or, with `alone`, at independent times."""
    up = _switched(world, effect, 0.08, 0.3) if effect["alone"] else world.level / world.plant.dry - 1.0
    return effect.size * world.plant.viscous * world.speed * up


def bursts(world: World, effect: Hidden) -> Array:
    """Return 1 for each sample at which the cage is unstable: during bursts, within a band of the speed."""
    share, law = world.share[FINE // 2 :: FINE], ("geometric", effect["sojourn"], 0.0)
    system = System("", (law, law), ((0.0, 0.0), (1.0, 1.0)))
    on = draw_path(system, world.samples, np.random.default_rng(int(effect["seed"])))[0]
    return on * ((share > effect["low"]) & (share < effect["high"]))


TORQUES: Final[dict[str, Callable[[World, Hidden], Array]]] = {
    "stribeck": lambda w, e: e.size * w.plant.dry * w.side * np.exp(-(np.abs(w.speed / e["speed"]) ** e["exponent"])),
    "presliding": lambda w, e: w.level * (_bristle(w, e["angle"]) - w.side),
    "coulomb_asymmetry": lambda w, e: e.size * w.level,
    "viscous_asymmetry": lambda w, e: e.size * w.plant.viscous * np.abs(w.speed),
    "viscosity_temperature": _viscosity,
    "sublinear_viscous": lambda w, e: e.size * w.plant.dry * w.side * w.share ** e["power"],
    "quadratic_drag": lambda w, e: e.size * w.plant.dry * w.side * w.share**2,
    "lubricant_lag": lambda w, e: e.size * w.plant.viscous * (w.speed - relax(w.speed, e["seconds"], w.step)),
    "run_in_drift": lambda w, e: e.size * w.plant.dry * w.side * np.exp(-w.time / (e["span"] * w.time[-1])),
    "torque_ripple": _ripple,
    "decaying_jump": _pockets,
    "viscous_jump": _slopes,
    "extra_switching_system": lambda w, e: (
        e.size * w.plant.dry * w.side * _switched(w, e, e["shortest"], 3.0 * e["shortest"])
    ),
    "cage_instability": lambda w, e: e.size * w.plant.noise * w.side * np.repeat(bursts(w, e), FINE),
}


# ---- sensors ---------------------------------------------------------------------------------------------------------


def sensed(world: World, hidden: Sequence[Hidden]) -> dict[str, Array]:
    """Return speed, current and friction as read by noiseless sensors; friction by the nominal constants."""
    plant = world.plant
    size = {one.name: one.size for one in hidden}
    friction = world.level * world.side + plant.viscous * world.speed
    for one in hidden:
        if one.name in TORQUES:
            friction = friction + TORQUES[one.name](world, one)
    torque = plant.inertia * (1.0 + size.get("inertia_error", 0.0)) * world.acceleration + friction
    torque = torque / (1.0 - size.get("load_dependence", 0.0) * world.side * np.sign(torque))  # c |K_T I| s
    warm = size.get("torque_constant_error", 0.0) + size.get("torque_constant_temperature", 0.0) * world.bearing
    motor = torque / (1.0 + warm) + size.get("torque_bias", 0.0) * plant.full_scale
    motor = np.interp(world.time - size.get("current_delay", 0.0), world.time, motor)
    return {
        "speed": _through_dead_zone(plant.sampled(world.speed), hidden),
        "current": plant.sampled(motor) / plant.torque_constant,
        "friction": plant.sampled(motor - plant.inertia * world.acceleration),
    }


def _through_dead_zone(speed: Array, hidden: Sequence[Hidden]) -> Array:
    """Return the reading of a tachometer with a dead zone: zero below its threshold, or the last reading held."""
    for one in hidden:
        if one.name == "speed_dead_zone":
            outside = np.abs(speed) >= one.size
            last = np.maximum.accumulate(np.where(outside, np.arange(speed.size), 0))
            speed = speed[last] if one["held"] else speed * outside
    return speed


def spread(world: World, hidden: Sequence[Hidden]) -> Array:
    """Return the relative standard deviation of the noise at each sample; one where no effect changes it."""
    share = world.share[FINE // 2 :: FINE]
    out = np.ones(share.size)
    for one in hidden:
        if one.name == "speed_dependent_noise":
            out *= 1.0 + one.size * (np.abs(share - one["band"]) < 0.12 if one["band"] else share)
        if one.name == "cage_instability":
            out *= 1.0 + one["louder"] * bursts(world, one)
    return out


def _noise(world: World, hidden: Sequence[Hidden], rng: np.random.Generator) -> Array:
    """Return the noise of the friction [N m]."""
    e = rng.standard_normal(world.samples)
    for one in hidden:
        if one.name == "heavy_tailed_noise" and one["packets"]:
            e = e * np.where(rng.uniform(size=e.size) < 0.01, 2.0 * one.size, 1.0)
        elif one.name == "heavy_tailed_noise":
            e = rng.standard_t(one.size, e.size)
        elif one.name == "coloured_noise":  # AR(1), with the coefficient φ per sample
            e = relax(np.sqrt((1.0 + one.size) / (1.0 - one.size)) * e, -1.0 / np.log(one.size), 1.0)
    return world.plant.noise * e * spread(world, hidden)


def measured(world: World, hidden: Sequence[Hidden], rng: np.random.Generator) -> dict[str, Array]:
    """Return the columns of the table, with noise and rounding."""
    plant, true = world.plant, sensed(world, hidden)
    steps = next((one.size for one in hidden if one.name == "tachometer_quantisation"), 0.5)

    def read(value: Array, noise: float, quantum: float) -> Array:
        return np.asarray(quantum * np.rint((value + noise * rng.standard_normal(value.size)) / quantum))

    speed = read(plant.sampled(world.speed), plant.speed_noise, steps * plant.speed_noise)
    columns: dict[str, Array] = {
        "time_s": np.arange(world.samples, dtype=np.float64) * plant.period,
        "speed_rad_s": _through_dead_zone(speed, hidden),
        "motor_current_A": read(true["current"], plant.current_noise, 0.5 * plant.current_noise),
        "bearing_temperature_degC": read(20.0 + plant.sampled(world.housing), 0.02, 0.05),
    }
    return columns | ({"friction_torque_Nm": true["friction"] + _noise(world, hidden, rng)} if plant.given else {})
