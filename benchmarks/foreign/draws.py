"""Draws the effects hidden in a record, of sizes that are testable given the truth, and writes the record's two files.

A size is drawn so that the true model gains `GAIN` over the base model: twice the log likelihood with noise and jumps
known, less what the base model recovers by false jumps. Ranges are those of the catalogue, with smaller sizes added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.foreign.generator import (
    FINE,
    TORQUES,
    Array,
    Hidden,
    Law,
    Plant,
    System,
    World,
    draw_plant,
    draw_world,
    measured,
    sensed,
    spread,
)

GAIN: Final = (60.0, 3000.0)
TRIES: Final = 300
REVERSALS: Final = 6  # with fewer, or with hardly any time in one direction, many effects are not distinguishable
SIGN: Final = 5.0  # standard deviations of the speed's noise, below which the sign is not known
APART: Final = 0.7  # largest correlation of two effects in one record
COMPARABLE: Final = 0.2  # least ratio of the RMS of their torques
# Units: the dry torque (stribeck, sublinear, quadratic, run-in, ripple, systems, jumps), f_v (asymmetry, lag, jump),
# full scale (bias), J and K_T; 1/K, s, rad/s; standard deviations of the speed's noise (tachometer) and of the
# friction's (cage); growth of the noise; φ; degrees of freedom; share of the declared duration; ratio of rates.
SIZES: Final = {
    "stribeck": (0.05, 1.0), "presliding": (1.0, 1.0), "coulomb_asymmetry": (0.003, 0.1), "torque_bias": (3e-4, 0.01),
    "viscous_asymmetry": (0.005, 0.1), "viscosity_temperature": (-0.08, -0.02), "sublinear_viscous": (0.05, 1.5),
    "quadratic_drag": (0.05, 1.5), "lubricant_lag": (0.02, 1.0), "run_in_drift": (0.03, 1.0),
    "load_dependence": (0.002, 0.15), "inertia_error": (0.002, 0.05), "torque_constant_error": (0.002, 0.05),
    "torque_constant_temperature": (-1.2e-3, -4e-4), "current_delay": (0.3, 2.0), "torque_ripple": (2e-3, 0.1),
    "speed_dead_zone": (0.5, 5.0), "decaying_jump": (0.1, 0.6), "viscous_jump": (0.05, 0.5),
    "extra_switching_system": (0.2, 0.6), "speed_dependent_noise": (0.3, 2.0), "coloured_noise": (0.3, 0.95),
    "heavy_tailed_noise": (2.5, 5.0), "tachometer_quantisation": (2.0, 6.0), "cage_instability": (2.0, 6.0),
    "wrong_duration_law": (0.12, 0.3), "speed_triggered_jumps": (5.0, 15.0),
}  # fmt: skip
MEAN: Final = tuple(SIZES)[:17]
SIGNED: Final = ("coulomb_asymmetry", "torque_bias", "viscous_asymmetry", "inertia_error", "torque_constant_error")
SCALED: Final = (  # to the wanted gain; sizes of others are drawn in their range, and the record kept where testable
    *SIGNED, "stribeck", "sublinear_viscous", "quadratic_drag", "lubricant_lag", "run_in_drift", "load_dependence",
    "torque_ripple", "decaying_jump", "viscous_jump",
)  # fmt: skip
NOISE: Final = ("speed_dependent_noise", "coloured_noise", "heavy_tailed_noise", "cage_instability")  # friction given
LOCAL: Final = ("presliding", "current_delay")  # large in a few samples only
SUDDEN: Final = (*LOCAL, "extra_switching_system")  # or at its jumps: such an effect does not mask a smooth one
ALONE: Final = ("torque_ripple", "tachometer_quantisation", "speed_dead_zone")  # need their own wheel or signal
ONE_OF: Final = (  # at most one of each group per record: nearly collinear by their formulas
    {"coulomb_asymmetry", "torque_bias", "viscous_asymmetry"},
    {"inertia_error", "torque_constant_error", "load_dependence", "torque_constant_temperature"},
    {"stribeck", "sublinear_viscous", "quadratic_drag"},
    {"wrong_duration_law", "speed_triggered_jumps"},
)


@dataclass(frozen=True, slots=True)
class Record:
    """A record with its truth: the hidden effects, the gain of each over the base model, columns of the table."""

    world: World
    declared: tuple[System, ...]
    hidden: tuple[Hidden, ...]
    gains: tuple[float, ...]
    columns: dict[str, Array]


# ---- what the truth gains --------------------------------------------------------------------------------------------


def beyond_base(world: World, effect: Hidden) -> Array:
    """Return the residual of an effect's torque after a fit of sign, speed and true levels [standard deviations].

    It is zero where the speed is below its noise, since its sign is not known there.
    """
    plant, level = world.plant, world.level[FINE // 2 :: FINE]
    speed, left = sensed(world, [effect])["speed"], np.zeros(level.size)
    for factor, seen in ((1.0, sensed(world, [effect])), (-1.0, sensed(world, []))):
        left += factor * (seen["friction"] - level * np.sign(seen["speed"]) - plant.viscous * seen["speed"])
    unknown = np.abs(plant.sampled(world.speed)) < SIGN * plant.speed_noise
    left[unknown], speed = 0.0, np.where(unknown, 0.0, speed)
    rest, slope = _off_levels(world, left, speed), _off_levels(world, speed, speed)
    return np.asarray((rest - slope * float(rest @ slope) / float(slope @ slope)) / plant.noise)


def _off_levels(world: World, value: Array, speed: Array) -> Array:
    """Return the residual of a column after a fit of one dry level between every two jumps."""
    side, out = np.sign(speed), value.copy()
    for begin, end in pairwise([0, *world.jumps, value.size]):
        part = slice(begin, end)
        moving = float(np.abs(side[part]).sum())
        out[part] -= side[part] * (side[part] @ value[part]) / max(moving, 1.0)
    return out


def base_score(folded: Array) -> float:
    """Return the sum of squares of a residual after greedy splitting by false jumps, plus 3 log N for each."""
    price, score, parts = 3.0 * np.log(folded.size), float(folded.var() * folded.size), [(0, folded.size)]
    while parts:
        begin, end = parts.pop()
        sums, count = np.cumsum(folded[begin:end]), np.arange(1, end - begin)
        if count.size == 0:
            continue
        before, total = sums[:-1], sums[-1]
        gain = before**2 / count + (total - before) ** 2 / (end - begin - count) - total**2 / (end - begin)
        cut = int(np.argmax(gain))
        if gain[cut] > price:
            score -= float(gain[cut]) - price
            parts += [(begin, begin + cut + 1), (begin + cut + 1, end)]
    return score


def _of_tails(effect: Hidden) -> float:
    """Return the expected log likelihood ratio per sample of the heavy-tailed law over a normal law of its variance."""
    x, step = np.linspace(-60.0, 60.0, 240_001, retstep=True)
    if effect["packets"]:
        wide = 2.0 * effect.size
        p = 0.99 * np.exp(-0.5 * x**2) + 0.01 * np.exp(-0.5 * (x / wide) ** 2) / wide
    else:
        p = (1.0 + x**2 / effect.size) ** (-0.5 * (effect.size + 1.0))
    p = np.maximum(p, 1e-300) / (p.sum() * step)
    return float((p * np.log(p)).sum() * step + 0.5 * np.log(2.0 * np.pi * (p * x**2).sum() * step) + 0.5)


def _by_angle(world: World, effect: Hidden, rest: Array) -> float:
    """Return the gain of a ripple over the angle integrated from noisy samples of the speed, whose phase drifts."""
    speed = sensed(world, [effect])["speed"]
    speed = speed + world.plant.speed_noise * np.random.default_rng(int(effect["seed"])).standard_normal(speed.size)
    angle = effect["order"] * np.cumsum(np.convolve(speed, (0.5, 0.5))[:-1]) * world.plant.period
    columns = np.stack([wave(times * angle) for times in (1.0, 2.0) for wave in (np.cos, np.sin)], axis=1)
    found = float(rest @ columns @ np.linalg.lstsq(columns, rest, rcond=None)[0])
    return found - 4.0 * float(np.log(rest.size))  # the penalty of four strengths


def gain_of(world: World, effect: Hidden) -> float:
    """Return twice the log likelihood ratio of the true model with and without an effect of the friction or noise."""
    samples, gain = world.samples, 0.0
    if effect.name == "coloured_noise":
        return -samples * float(np.log(1.0 - effect.size**2))
    if effect.name == "heavy_tailed_noise":
        return 2.0 * samples * _of_tails(effect)
    if effect.name == "tachometer_quantisation":
        return samples * float(np.log(1.0 + effect.size**2 / 12.0))
    rest = beyond_base(world, effect)
    if effect.name == "torque_ripple":
        return _by_angle(world, effect, rest)
    folded = rest * world.side[FINE // 2 :: FINE]
    if effect.name == "extra_switching_system":  # free jumps cost log N each, jumps of a system much less
        moves = int(np.count_nonzero(np.abs(np.diff(folded)) > 4.0))
        return 2.0 * moves * (float(np.log(moves + 1.0)) - 1.0)
    if effect.name in NOISE:
        variance = spread(world, [effect]) ** 2
        gain = float(samples * np.log(variance.mean()) - np.log(variance).sum())
    return gain + base_score(folded)


# ---- drawing what is hidden ------------------------------------------------------------------------------------------


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw_shape(name: str, rng: np.random.Generator) -> dict[str, float]:
    """Draw the shape parameters of an effect."""
    alone = float(rng.integers(2))
    shapes: dict[str, dict[str, float]] = {
        "stribeck": {"speed": _log(rng, 1.0, 30.0), "exponent": 1.0 + alone},
        "presliding": {"angle": _log(rng, 1e-3, 1.0)},
        "sublinear_viscous": {"power": float(rng.choice((0.5, 0.6, 2.0 / 3.0)))},
        "lubricant_lag": {"seconds": _log(rng, 10.0, 1800.0)},
        "run_in_drift": {"span": _log(rng, 0.3, 1.5)},
        "torque_ripple": {"order": float(rng.choice((1.0, 2.0, 3.0, 6.0))), "second": rng.uniform(0.0, 0.6)},
        "speed_dependent_noise": {"band": float(rng.choice((0.0, 0.25, 0.5)))},
        "heavy_tailed_noise": {"packets": alone},
        "cage_instability": {
            "low": rng.uniform(0.1, 0.3), "high": rng.uniform(0.45, 0.7), "louder": rng.uniform(1.0, 3.0),
            "sojourn": _log(rng, 40.0, 300.0),
        },
        "speed_dead_zone": {"held": alone},
        "viscous_jump": {"alone": alone},
        "decaying_jump": {"alone": alone, "events": float(rng.integers(4, 11)), "seconds": _log(rng, 50.0, 800.0)},
        "extra_switching_system": {"shortest": _log(rng, 0.01, 0.03)},
    }  # fmt: skip
    return shapes.get(name, {}) | {"seed": float(rng.integers(2**31))}


def draw_effect(name: str, world: World, rng: np.random.Generator) -> tuple[Hidden, float]:
    """Draw shape and size of an effect; return it with its gain in this record."""
    low, high = SIZES[name]
    shape, sign = draw_shape(name, rng), float(rng.choice((-1.0, 1.0))) if name in SIGNED else 1.0
    effect = Hidden(name, _log(rng, low, high) if name in LOCAL else rng.uniform(low, high), shape)
    if name in SCALED:
        middle = replace(effect, size=sign * float(np.sqrt(low * high)))
        full = beyond_base(world, middle)
        scale = np.sqrt(_log(rng, *GAIN) / max(float(full @ full), 1e-12))
        effect = replace(middle, size=sign * float(np.clip(abs(middle.size) * scale, low, high)))
    return effect, gain_of(world, effect)


def draw_law(mean: float, rng: np.random.Generator) -> Law:
    """Return a law of sojourns with about this mean [samples]."""
    family = str(rng.choice(("uniform", "geometric", "weibull", "lognormal")))
    if family == "uniform":
        return family, float(np.rint(0.5 * mean)), float(np.rint(1.5 * mean))
    if family == "weibull":
        return family, rng.uniform(1.3, 3.0), 1.1 * mean
    if family == "lognormal":
        return family, float(np.log(mean)) - 0.1, rng.uniform(0.3, 0.6)
    return family, mean, 0.0


def draw_systems(rng: np.random.Generator) -> tuple[tuple[System, ...], float]:
    """Draw one or two systems of two or three configurations; return them and the mean rest duration of the first."""
    systems, rests = [], []
    for number in range(int(rng.integers(1, 3))):
        rest, low = rng.uniform(1500.0, 5000.0), rng.uniform(0.2, 0.5)
        laws = [draw_law(rest, rng), draw_law(rest * rng.uniform(0.05, 0.8), rng)]
        ranges = [(0.0, 0.0), (low, 1.3 * low)]
        if rng.integers(2):
            laws.append(draw_law(rest * rng.uniform(0.2, 0.6), rng))
            ranges.append((1.8 * low, 2.3 * low))
        systems.append(System(f"system_{number + 1}", tuple(laws), tuple(ranges)))
        rests.append(rest)
    return tuple(systems), rests[0]


def log_density(law: Law, x: float) -> float:
    """Return the log probability of a sojourn, at least log(1e-4 / x): a ten-thousandth of a broad law's."""
    family, a, b = law
    if family == "uniform":
        p = 1.0 / (b - a + 1.0) if a <= x <= b else 0.0
    elif family == "weibull":
        p = a / b * (x / b) ** (a - 1.0) * np.exp(-((x / b) ** a))
    elif family == "lognormal":
        p = np.exp(-0.5 * ((np.log(x) - a) / b) ** 2) / (x * b * np.sqrt(2.0 * np.pi))
    else:
        p = np.exp(-(x - 1.0) / a) / a
    return float(np.log(max(p, 1e-4 / x)))


def _restless(rng: np.random.Generator) -> tuple[System, ...]:
    """Return a memoryless system that switches often, so that a rate that follows the speed is identifiable."""
    rest, low = rng.uniform(150.0, 400.0), rng.uniform(0.3, 0.6)
    laws: tuple[Law, ...] = (("geometric", rest, 0.0), ("geometric", rest * rng.uniform(0.5, 1.0), 0.0))
    return (System("system_1", laws, ((0.0, 0.0), (low, 1.3 * low))),)


def _clock(share: Array, ratio: float) -> Array:
    """Rate of the jumps at each sample, with a mean of one: larger by a ratio above a third of the highest speed."""
    rate = 1.0 + (ratio - 1.0) * (share > 0.33)
    return np.asarray(rate / rate.mean())


def _of_switching(world: World, effect: Hidden, true: System, declared: System) -> float:
    """Twice the log likelihood ratio of the first system's complete sojourns, by the true over the declared laws."""
    clock, gain = _clock(world.share[FINE // 2 :: FINE], effect.size), 0.0
    for q, begin, length in world.sojourns[0][1:-1]:
        if effect.name == "wrong_duration_law":
            gain += log_density(true.laws[q], length) - log_density(declared.laws[q], length)
        else:
            end = begin + length
            gain += float(np.log(clock[end - 1])) - float(clock[begin:end].sum() - length) / declared.laws[q][1]
    return 2.0 * gain


def draw_record(names: Sequence[str], samples: int, rng: np.random.Generator) -> Record:
    """Draw wheel, motion and jumps until every effect to be hidden is testable in them.

    Raises
    ------
    ValueError
        If none of `TRIES` draws is.
    """
    for _ in range(TRIES):
        record = _try(names, samples, rng)
        if record is not None:
            return record
    raise ValueError(f"no record in which {', '.join(names)} can be tested")


def _try(names: Sequence[str], samples: int, rng: np.random.Generator) -> Record | None:
    given = any(name in NOISE for name in names) or bool(rng.integers(3))
    plant = draw_plant(rng, given and "tachometer_quantisation" not in names)
    if "torque_ripple" in names:  # no averaging, and an integrated angle that keeps its coherence
        plant = replace(plant, averaged=False, speed_noise=min(plant.speed_noise, 2e-3), period=0.2)
    declared, rest = draw_systems(rng)
    sizes = {name: float(rng.uniform(*SIZES[name])) for name in names if name in ONE_OF[-1]}
    if "speed_triggered_jumps" in names:
        declared = _restless(rng)
    ratio = sizes.get("speed_triggered_jumps", 1.0)
    true = declared
    if "wrong_duration_law" in names:
        law = draw_law(sizes["wrong_duration_law"] * rest, rng)
        true = (replace(declared[0], laws=(law, *declared[0].laws[1:])), *declared[1:])
    world = draw_world(plant, true, samples, rng, lambda share: _clock(share, ratio))
    if not _rich(world.speed):
        return None
    hidden, gains = [], []
    for name in names:
        effect, gain = (Hidden(name, sizes[name]), 0.0) if name in sizes else draw_effect(name, world, rng)
        if name in sizes:
            gain = _of_switching(world, effect, true[0], declared[0])
        if gain < GAIN[0]:
            return None
        hidden.append(effect)
        gains.append(gain)
    if not _two(world, hidden):
        return None
    return Record(world, declared, tuple(hidden), tuple(gains), measured(world, hidden, rng))


def _rich(speed: Array) -> bool:
    forward = float(np.mean(speed > 0.0))
    return 0.2 < forward < 0.8 and int(np.count_nonzero(np.diff(np.sign(speed)))) >= REVERSALS


def _two(world: World, hidden: Sequence[Hidden]) -> bool:
    """Whether two effects of the friction are weakly correlated, and neither is masked by the other."""
    rest = [beyond_base(world, one) for one in hidden if one.name in MEAN or one.name in TORQUES]
    if len(rest) < 2:
        return True
    (a, b), product = (float(one @ one) for one in rest), float(abs(rest[0] @ rest[1]))
    comparable = min(a, b) > COMPARABLE**2 * max(a, b) or any(one.name in SUDDEN for one in hidden)
    return comparable and product < APART * np.sqrt(a * b)


def plan(records: int, rng: np.random.Generator) -> list[tuple[str, ...]]:
    """Return the effects that each record hides: every name in turn, in random order; one record in five hides two."""
    queue: list[str] = []

    def take(allowed: Sequence[str]) -> str:
        if not any(name in allowed for name in queue):
            queue.extend(str(name) for name in rng.permutation(list(SIZES)))
        name = next(name for name in queue if name in allowed)
        queue.remove(name)
        return name

    drawn: list[tuple[str, ...]] = []
    for number in range(records):
        first = take([name for name in MEAN if name not in ALONE] if number % 5 == 4 else list(SIZES))
        like = {first, *ALONE}.union(*(group for group in ONE_OF if first in group))
        drawn.append((first, take([name for name in SIZES if name not in like])) if number % 5 == 4 else (first,))
    return drawn


# ---- files -----------------------------------------------------------------------------------------------------------

KEYS: Final = {
    "uniform": ("low", "high"), "weibull": ("shape", "scale"), "lognormal": ("mu", "sigma"), "geometric": ("mean",)
}  # fmt: skip


def _durations(law: Law) -> str:
    family, *numbers = law
    words = (f"{key} = {value:.9g}" for key, value in zip(KEYS[family], numbers, strict=False))
    return f'{{ law = "{family}", {", ".join(words)} }}'


def _wheel_file(plant: Plant, systems: Sequence[System]) -> str:
    lines = [
        "[wheel]", 'name = "foreign"', f"sample_period_s = {plant.period}", f"inertia_kg_m2 = {plant.inertia:.9g}",
        f"torque_constant_Nm_A = {plant.torque_constant:.9g}", "[nominal]", f"dry_torque_Nm = {plant.dry:.9g}",
        f"viscous_Nm_s_rad = {plant.viscous:.9g}", f"nominal_speed_rad_s = {plant.top_speed:.9g}",
    ]  # fmt: skip
    for system in systems:
        ranges = (f"{{ low = {low:.4g}, high = {high:.4g} }}" for low, high in system.friction)
        lines += [
            "[[fss]]", f'name = "{system.name}"', f"durations = [ {', '.join(map(_durations, system.laws))} ]",
            f"friction = [ {', '.join(ranges)} ]",
        ]  # fmt: skip
    return "\n".join(lines) + "\n"


def write(record: Record, folder: Path) -> tuple[Path, Path]:
    """Write sample table and wheel file; return their paths."""
    table, wheel = folder / "record.csv", folder / "wheel.toml"
    values = np.column_stack(list(record.columns.values()))
    np.savetxt(table, values, fmt="%.9g", delimiter=",", header=",".join(record.columns), comments="")
    wheel.write_text(_wheel_file(record.world.plant, record.declared), encoding="utf-8")
    return table, wheel
