"""What repeats with the angle of the wheel at any order, whole or not: a cage, balls that pass, a gear.

The residual is laid on an even grid of the angle, where a line of any order is a line of its spectrum, as sharp as one
over the turns of the record. A line in time, or in a motion that repeats, is none in the angle: it is held to show at
low and at high speed alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import fft, optimize

from rwa_monitor.discrepancy.base_fit import Fit
from rwa_monitor.discrepancy.likelihood import ACCEPT_GAIN
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import Record
from rwa_monitor.messages import Unexplained
from rwa_monitor.samples import TINY, FloatArray
from rwa_monitor.wheel.effects.torque_ripple import (
    LOWEST_ORDER,
    MANY_TURNS,
    MAX_HARMONIC,
    TorqueRipple,
    angle_turned,
    coherent_slots,
)

CELLS_PER_PERIOD: Final = 4  # of the highest order: what falls between cells blurs it by a tenth
MOST_CELLS: Final = 2**21  # of a record; where it turns more often, high orders are not looked for
NEAR: Final = 401  # orders around a line, in a block, that show what is there without it
FEWEST_BLOCKS: Final = 4  # of orders, where a record has few
SURE: Final = 15.0  # nepers of the false-alarm probability, over all orders tried, in powers of the background
SURE_HARMONIC: Final = 12.0  # the same for one order that is given
MOST_HARMONICS: Final = 20  # of a line: a rub that lasts a twentieth of a turn has so many alike
FEWEST_WAVES: Final = 3.0  # within the range of the angle: fewer do not separate a line from a trend
SAME_SHARE: Final = 0.5  # of the whole amplitude that low and high speeds must each show, in phase
CLEARLY: Final = 1.1  # times the power: a tenth of the record in the other direction makes half as much again
WHOLE_WITHIN: Final = 0.01  # of an order: as near to a whole one it is left to the ripple
RESOLVED: Final = 1.0  # over the turns of the record: nearer to a whole order is whole
SHARP: Final = 0.05  # of an order: the most that one over the turns may be


@dataclass(frozen=True, slots=True)
class AngleLine:
    """A drag that is periodic in the wheel's angle, at an order that is no whole number.

    Attributes
    ----------
    order, order_std
        Periods per turn of the wheel [-].
    torque_Nm
        float64 (n,), on the slots of its record.
    size_Nm
        Root mean square [N m].
    """

    order: float
    order_std: float
    torque_Nm: FloatArray
    size_Nm: float

    def unexplained(self) -> Unexplained:
        """Return it as what no effect of the catalogue explains."""
        digits = max(int(np.ceil(-np.log10(max(self.order_std, 1e-6)))), 2)
        order = f"{self.order:.{digits}f} ± {self.order_std:.1g}"
        why = "no whole number: the cage, or balls that pass"
        return Unexplained(
            signature=f"a drag that is periodic in the wheel's angle at order {order} of its turns ({why})",
            size_Nm=self.size_Nm,
        )


def angle_line(problem: Problem, base: Fit) -> AngleLine | float | None:
    """Return the line that the residual of the base model shows over the angle; None where there is none.

    Of a torque that does not follow the direction it is the order alone, for a ripple to try. So it is in a record of
    few turns: there lines are broad, and what else is missing lies beneath them; the strongest is not sure by itself,
    but the search may judge a ripple of that order as it judges those of whole orders.

    Looked for in a single record; of one speed, lines over the angle and over time are the same.
    """
    if problem.at_one_speed or len(problem.records) > 1:
        return None
    turns = angle_turned(problem.records[0].undrifted)[0] / (2.0 * np.pi)
    at = turns[problem.slot]
    whole = float(np.ptp(at))
    of_drag, of_ripple = base.residual, base.residual * problem.sign
    if whole < MANY_TURNS:
        above, tried = _spectrum(at, of_ripple, whole) if whole > 0.0 else (at[:0], at[:0])
        return float(tried[np.argmax(above)]) if above.size else None
    if RESOLVED / whole > SHARP:
        return None
    ripple, drag = problem.each(lambda values: _peak(at, values, whole), (of_ripple, of_drag))
    # In one direction the two are the same: a ripple then, which has a name.
    flips = drag is not None and (ripple is None or drag[0] > CLEARLY * ripple[0])
    peak, values = (drag, of_drag) if flips else (ripple, of_ripple)
    if peak is None:
        return None
    order = _refined(values, at, peak[1], whole)
    amplitude = 2.0 * abs(_sum(values, at, order)) / at.size
    gain = 0.5 * at.size * amplitude**2 / problem.noise.long_run_variance
    if gain < ACCEPT_GAIN + len(TorqueRipple.parameters) * problem.log_size or not _at_all_speeds(
        problem, values, at, order
    ):
        return None
    # Changes of direction make sidebands of a ripple of whole order, which follow the direction.
    if round(order) >= 1 and abs(order - round(order)) < max(RESOLVED / whole, WHOLE_WITHIN):
        return None
    if not flips:
        return order
    std = float(np.sqrt(2.0 / at.size) * np.std(values) / max(2 * np.pi * amplitude * float(np.std(at)), TINY))
    # The harmonics that are sure, laid on the slots.
    sure = SURE_HARMONIC * at.size * float(np.var(values))
    kept = [k for k in range(1, MOST_HARMONICS + 1) if k == 1 or abs(_sum(values, at, k * order)) ** 2 > sure]
    angle = np.outer(2.0 * np.pi * order * turns, kept)
    design = np.column_stack([np.cos(angle), np.sin(angle)])
    torque = np.nan_to_num(design @ np.linalg.lstsq(design[problem.slot], values)[0])
    torque *= np.nan_to_num(problem.records[0].channels.direction)
    return AngleLine(order, std, torque, float(np.sqrt(np.mean(torque[problem.slot] ** 2))))


def ripple_with(order: float) -> type[TorqueRipple]:
    """Return the effect `torque_ripple` as a candidate of the search that tries an order more."""
    *strengths, harmonic = TorqueRipple.parameters
    tried = (*strengths, replace(harmonic, choices=(*harmonic.choices, order)))
    return type("TorqueRippleOfAnyOrder", (TorqueRipple,), {"parameters": tried})


def _sum(values: FloatArray, at: FloatArray, order: float) -> complex:
    return complex(np.sum(values * np.exp(-2j * np.pi * order * at)))


def _peak(at: FloatArray, values: FloatArray, whole: float) -> tuple[float, float] | None:
    """Return how far the surest line is above what is around it, and the order of its fundamental; None if none is."""
    above, order = _spectrum(at, values, whole)
    if order.size < NEAR:
        return None
    best = int(np.argmax(above))
    if above[best] < SURE + np.log(above.size):
        return None
    for parts in (4, 3, 2):  # the surest may be a harmonic
        part = order[best] / parts
        near = np.abs(order - part) <= 1.0 / whole
        if part >= order[0] and near.any() and float(above[near].max()) > SURE_HARMONIC:
            return float(above[best]), float(order[near][np.argmax(above[near])])
    return float(above[best]), float(order[best])


def _spectrum(at: FloatArray, values: FloatArray, whole: float) -> tuple[FloatArray, FloatArray]:
    """Return the power over the angle, and its orders, two for each that the range of the angle resolves.

    It is relative to what the power around each order would be on average without lines, from medians of blocks of
    orders: what is smooth over the angle, as a law of speed that is missing, is no line.
    """
    per_turn = min(CELLS_PER_PERIOD * MAX_HARMONIC, int(MOST_CELLS / whole))
    size = fft.next_fast_len(max(int(2 * whole * per_turn), 1), real=True)
    cells = np.bincount(((at - at.min()) * per_turn).astype(np.int64), values, size)
    power = np.abs(fft.rfft(cells)) ** 2
    order = np.arange(power.size) * per_turn / size
    tried = (order >= max(LOWEST_ORDER, FEWEST_WAVES / whole)) & (
        order <= min(MAX_HARMONIC, per_turn / CELLS_PER_PERIOD)
    )
    power, order = power[tried], order[tried]
    near = min(NEAR, power.size // FEWEST_BLOCKS)
    if near == 0:
        return power[:0], order[:0]
    blocks = power[: power.size - power.size % near].reshape(-1, near)
    middle = (np.arange(len(blocks)) + 0.5) * near
    # The median of an exponential law is log 2 of its mean.
    around = np.interp(np.arange(power.size), middle, np.median(blocks, axis=1) / np.log(2.0))
    return power / np.maximum(around, TINY), order


def _refined(values: FloatArray, at: FloatArray, order: float, whole: float) -> float:
    """Return the order of most power within one resolved order."""
    limits = (order - 0.5 / whole, order + 0.5 / whole)
    found = optimize.minimize_scalar(lambda h: -abs(_sum(values, at, h)), bounds=limits, method="bounded")
    return float(found.x)


def _at_all_speeds(problem: Problem, values: FloatArray, at: FloatArray, order: float) -> bool:
    """Return whether low and high speeds show a line of the same size and phase."""
    slow = problem.speed <= np.median(problem.speed)
    both = _sum(values, at, order) / at.size
    parts = [_sum(values[part], at[part], order) / max(int(part.sum()), 1) for part in (slow, ~slow)]
    return all((part * np.conj(both)).real >= SAME_SHARE * abs(both) ** 2 for part in parts)


# ---- how far the integrated angle has drifted, by the phase of a torque ripple ---------------------------------------
# The angle of the wheel is the integral of a noisy speed: its error is a random walk, and after `coherent_slots` the
# phase of a harmonic is lost by a radian (docs/effects/torque_ripple.md). Over blocks shorter than
# that a harmonic is a line still; the phases of the blocks, smoothed by the random walk that the speed's noise makes,
# give the drift, and with it the ripple is coherent over the whole record.


ComplexArray = NDArray[np.complex128]

BLOCKS_PER_COHERENCE: Final = 8  # the phase wanders by 1/√8 rad within a block
SHORTEST_BLOCK: Final = 32  # slots: shorter sums hold too little of a line
MOST_BLOCKS: Final = 16  # in which the time between friction and speed is looked for
FINE: Final = 8  # places that are tried within a line's width
SURE_DRIFT: Final = 8.0  # standard deviations of the blocks' power above noise, the best of 48 harmonics


def with_angle_drift(problem: Problem, base: Fit) -> Problem:
    """Return the problem with the drift of each record's angle, where a ripple shows it.

    Parameters
    ----------
    problem
        The data.
    base
        A fit whose residual holds the ripple.
    """
    residuals = problem.spread(base.residual * problem.sign)
    drifts = [
        track_drift(record, np.where(record.used, residual, 0.0), problem.noise.long_run_variance)
        for record, residual in zip(problem.records, residuals, strict=True)
    ]
    if all(drift is None for drift in drifts):
        return problem
    records = [replace(one, angle_drift_rad=drift) for one, drift in zip(problem.records, drifts, strict=True)]
    return replace(problem, records=tuple(records))


def track_drift(record: Record, residual_Nm: FloatArray, variance: float) -> FloatArray | None:
    """Return the drift of the angle, float64 (n,) [rad]; None where no ripple is sure or the angle is measured.

    Parameters
    ----------
    record
        The record: its speed and the noise of it.
    residual_Nm
        float64 (n,), what a model leaves of the torque on the slots, 0 where unknown.
    variance
        Variance of the residual's noise at any frequency, at most [N² m²].
    """
    channels = record.channels
    if channels.measured_angle_rad is not None:
        return None
    later_s = time_between(record, residual_Nm)
    moved = later_s * np.nan_to_num(channels.speed_rad_s)
    angle = channels.angle_rad + moved
    counted = (residual_Nm != 0.0).astype(np.float64)
    sure: list[tuple[float, int, int, ComplexArray, FloatArray]] = []
    for harmonic in range(1, MAX_HARMONIC + 1):
        length = _block(harmonic, record)
        if 2 * length > residual_Nm.size:
            continue
        edges = np.arange(0, residual_Nm.size, length)
        sums = np.add.reduceat(residual_Nm * np.exp(-1j * harmonic * angle), edges)
        count = np.add.reduceat(counted, edges)
        filled = count > 0
        power = 2.0 * np.abs(sums[filled]) ** 2 / (count[filled] * variance)  # χ² with two degrees, twice a mean of 1
        excess = float(np.sum(power - 2.0) / np.sqrt(4.0 * power.size))
        if excess > SURE_DRIFT:
            sure.append((excess, harmonic, length, sums, count))
    if not sure:
        return moved if later_s else None
    _, harmonic, length, sums, count = max(sure, key=lambda one: one[0])
    step = harmonic * record.speed_noise_rad_s * channels.sample_period_s
    phase = smooth_phase(sums, count * variance / 2.0, step**2 * length)
    middle = np.minimum(np.arange(sums.size) * length + 0.5 * length, residual_Nm.size)
    return np.asarray(moved + np.interp(np.arange(residual_Nm.size), middle, phase) / harmonic)


def time_between(record: Record, residual_Nm: FloatArray) -> float:
    """Return by how much later friction is read than the speed [s], by the phase of a ripple; 0 where none is sure.

    The wheel has then turned on by as much: the phase of a harmonic goes with the speed, and over an even grid of the
    speed that is a line, within a sample's time. Its power is summed over blocks in which the phase wanders little.

    Parameters
    ----------
    record, residual_Nm
        As for `track_drift`.
    """
    channels, total = record.channels, float(residual_Nm @ residual_Nm)
    period_s, angle, speed = channels.sample_period_s, channels.angle_rad, np.nan_to_num(channels.speed_rad_s)
    if total == 0.0 or float(np.ptp(angle)) < 2.0 * np.pi * MANY_TURNS:
        return 0.0
    found, later_s, tried = 0.0, 0.0, 1
    for harmonic in range(1, MAX_HARMONIC + 1):
        blocks = -(-speed.size // _block(harmonic, record))
        if blocks > MOST_BLOCKS:
            break
        cell = np.pi / (2.0 * harmonic * period_s)
        at = ((speed - speed.min()) / cell).astype(np.int64)
        size = fft.next_fast_len(FINE * (int(at.max()) + 1))
        at += np.arange(speed.size) * blocks // speed.size * size
        turned = residual_Nm * np.exp(-1j * harmonic * angle)
        cells = np.bincount(at, turned.real, blocks * size) + 1j * np.bincount(at, turned.imag, blocks * size)
        power = np.sum(np.abs(fft.fft(cells.reshape(blocks, size))) ** 2, axis=0)
        # Of noise, a power is a sum of so many exponential laws: its median is a third of one below its mean.
        power /= max(total / blocks, float(np.median(power)) / (blocks - 1.0 / 3.0), TINY)
        times_s = 2.0 * np.pi * fft.fftfreq(size, cell) / harmonic
        within = np.flatnonzero(np.abs(times_s) <= period_s)
        best = within[np.argmax(power[within])]
        tried += within.size
        gained = float(power[best] - power[0]) / np.sqrt(blocks)
        if gained > found:
            found, later_s = gained, float(times_s[best])
    return later_s if found > SURE + np.log(tried) else 0.0


def _block(harmonic: int, record: Record) -> int:
    """Return over how many slots the phase of a harmonic wanders little."""
    coherent = coherent_slots(harmonic, record.speed_noise_rad_s, record.channels.sample_period_s)
    return max(coherent // BLOCKS_PER_COHERENCE, SHORTEST_BLOCK)


def smooth_phase(sums: ComplexArray, noise: FloatArray, walk: float) -> FloatArray:
    """Smooth the phases of complex sums that wander as a random walk (Rauch, Tung and Striebel, AIAA J. 3, 1965).

    Parameters
    ----------
    sums
        complex128 (m,), sum of each block.
    noise
        float64 (m,), variance of each quadrature of a sum.
    walk
        Variance of the change of phase from one block to the next [rad²].

    Returns
    -------
    FloatArray
        float64 (m,) [rad], unwrapped.
    """
    amplitude2 = max(float(np.sum(np.abs(sums) ** 2 - 2.0 * noise)) / max(sums.size, 1), TINY)
    spread = np.maximum(noise, 1e-3 * amplitude2) / amplitude2  # of a phase, to first order
    first = int(np.argmax(np.abs(sums)))
    mean, variance = np.empty(sums.size), np.empty(sums.size)
    for order in (range(first, sums.size), range(first, -1, -1)):  # outwards from the surest block
        at, uncertainty = float(np.angle(sums[first])), float(spread[first])
        for k in order:
            if k != first:
                uncertainty += walk
                turn = float(np.angle(sums[k] * np.exp(-1j * at)))  # to the nearest turn
                gain = uncertainty / (uncertainty + float(spread[k]))
                at, uncertainty = at + gain * turn, (1.0 - gain) * uncertainty
            mean[k], variance[k] = at, uncertainty
    inwards = [(k, k + 1) for k in range(sums.size - 2, first - 1, -1)] + [(k, k - 1) for k in range(1, first + 1)]
    for k, later in inwards:
        mean[k] += variance[k] / (variance[k] + walk) * (mean[later] - mean[k])
    return mean
