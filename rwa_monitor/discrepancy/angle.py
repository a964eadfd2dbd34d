"""Torque that is periodic in the angle of the wheel at any order, integer or not: from a cage, passing balls, a gear.

The residual is assigned to an even grid of the angle, where a periodic torque is a line of the spectrum, of width one
over the turns of the record. To reject torque that is periodic in time, or in a motion that repeats, a line must
have the same amplitude and phase at low and at high speed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft, optimize

from rwa_monitor.discrepancy.base_fit import Fit, fit
from rwa_monitor.discrepancy.likelihood import ACCEPT_GAIN
from rwa_monitor.discrepancy.problem import Problem, rms
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

CELLS_PER_PERIOD: Final = 4  # of the highest order, which averaging over a cell attenuates by a tenth
MOST_CELLS: Final = 2**21  # of a record; in records of more turns, high orders are not searched
BACKGROUND_ORDERS: Final = 401  # orders in a block, from which the background of the spectrum is estimated
FEWEST_BLOCKS: Final = 4  # blocks of orders, where a record has few orders
LINE_THRESHOLD: Final = 15.0  # -log of the false-alarm probability over all orders tried; power over the background
HARMONIC_THRESHOLD: Final = 12.0  # the same for a single given order
MOST_HARMONICS: Final = 20  # of a line: a rub that lasts a twentieth of a turn has as many of similar size
FEWEST_WAVES: Final = 3.0  # periods within the range of the angle: fewer do not separate a line from a trend
SAME_SHARE: Final = 0.5  # of the overall amplitude that low and high speeds must each have, in phase
DRAG_POWER_RATIO: Final = 1.1  # ratio of powers; a tenth of the record in the other direction already raises it to 1.5
WHOLE_WITHIN: Final = 0.01  # orders closer than this to an integer are left to the ripple


class AngleLine(NamedTuple):
    """A drag that is periodic in the wheel's angle, at a non-integer order.

    `torque_Nm`: on the slots of its record, float64 (n,). `finding`: as no effect of the catalogue explains it.
    """

    torque_Nm: FloatArray
    finding: Unexplained


def angle_line(problem: Problem) -> AngleLine | float | None:
    """Return the line in the residual of the base model over the angle; None where there is none.

    If the torque does not change sign with the direction, only its order is returned, as a candidate for a ripple. The
    same holds for the strongest line of a record of few turns: its lines are broad and overlap with other missing
    effects, so that their significance is left to the search, which tests a ripple of that order like integer orders.

    Only a single record is searched. At a constant speed, lines over the angle and over time are not separable.
    """
    if problem.at_one_speed or len(problem.records) > 1:
        return None
    turns = angle_turned(problem.records[0].undrifted)[0] / (2.0 * np.pi)
    at = turns[problem.slot]
    whole = float(np.ptp(at))
    of_drag = fit(problem).residual
    of_ripple = of_drag * problem.sign
    if whole < MANY_TURNS:
        above, tried = _spectrum(at, of_ripple, whole) if whole > 0.0 else (at[:0], at[:0])
        return float(tried[np.argmax(above)]) if above.size else None
    ripple, drag = problem.each(lambda values: _strongest_line(at, values, whole), (of_ripple, of_drag))
    # With one direction of rotation the two are the same, and a ripple is assumed, which is in the catalogue.
    flips = drag is not None and (ripple is None or drag[0] > DRAG_POWER_RATIO * ripple[0])
    peak, values = (drag, of_drag) if flips else (ripple, of_ripple)
    if peak is None:
        return None
    limits = peak[1] - 0.5 / whole, peak[1] + 0.5 / whole
    best = optimize.minimize_scalar(lambda h: -abs(_fourier_sum(values, at, h)), bounds=limits, method="bounded")
    order = float(best.x)
    amplitude = 2.0 * abs(_fourier_sum(values, at, order)) / at.size
    gain = 0.5 * at.size * amplitude**2 / problem.noise.long_run_variance
    # Changes of direction cause sidebands of a ripple of integer order, which change sign with the direction.
    is_whole = round(order) >= 1 and abs(order - round(order)) < max(1.0 / whole, WHOLE_WITHIN)
    least_gain = ACCEPT_GAIN + len(TorqueRipple.parameters) * problem.log_size
    if is_whole or gain < least_gain or not _at_all_speeds(problem, values, at, order):
        return None
    if not flips:
        return order
    std = float(np.sqrt(2.0 / at.size) * np.std(values) / max(2 * np.pi * amplitude * float(np.std(at)), TINY))
    # The significant harmonics are fitted and evaluated on all slots.
    sure = HARMONIC_THRESHOLD * at.size * float(np.var(values))
    kept = [k for k in range(1, MOST_HARMONICS + 1) if k == 1 or abs(_fourier_sum(values, at, k * order)) ** 2 > sure]
    angle = np.outer(2.0 * np.pi * order * turns, kept)
    design = np.column_stack([np.cos(angle), np.sin(angle)])
    torque = np.nan_to_num(design @ np.linalg.lstsq(design[problem.slot], values)[0])
    torque *= np.nan_to_num(problem.records[0].channels.direction)
    digits = max(int(np.ceil(-np.log10(max(std, 1e-6)))), 2)
    signature = (
        f"a drag that is periodic in the wheel's angle at order {order:.{digits}f} ± {std:.1g} of its turns (no whole"
        " number: the cage, or balls that pass)"
    )
    return AngleLine(torque, Unexplained(signature=signature, size_Nm=rms(torque[problem.slot])))


def ripple_with(order: float) -> type[TorqueRipple]:
    """Return the effect `torque_ripple` as a candidate of the search with one further order to try."""
    *strengths, harmonic = TorqueRipple.parameters
    tried = (*strengths, replace(harmonic, choices=(*harmonic.choices, order)))
    return type("TorqueRippleOfAnyOrder", (TorqueRipple,), {"parameters": tried})


def _fourier_sum(values: FloatArray, at: FloatArray, order: float) -> complex:
    return complex(np.sum(values * np.exp(-2j * np.pi * order * at)))


def _strongest_line(at: FloatArray, values: FloatArray, whole: float) -> tuple[float, float] | None:
    """Return the strongest line's power over the background, and the order of its fundamental; None if none."""
    above, order = _spectrum(at, values, whole)
    if order.size < BACKGROUND_ORDERS:
        return None
    best = int(np.argmax(above))
    if above[best] < LINE_THRESHOLD + np.log(above.size):
        return None
    for parts in (4, 3, 2):  # the strongest line may be a harmonic
        part = order[best] / parts
        near = np.abs(order - part) <= 1.0 / whole
        if part >= order[0] and near.any() and float(above[near].max()) > HARMONIC_THRESHOLD:
            return float(above[best]), float(order[near][np.argmax(above[near])])
    return float(above[best]), float(order[best])


def _spectrum(at: FloatArray, values: FloatArray, whole: float) -> tuple[FloatArray, FloatArray]:
    """Return the power spectrum over the angle, and its orders, spaced by half of the angle's resolution.

    The power is relative to the background, which is estimated by medians of blocks of orders. A residual that is
    smooth over the angle, such as that of a missing law of speed, therefore causes no line.
    """
    per_turn = min(CELLS_PER_PERIOD * MAX_HARMONIC, int(MOST_CELLS / whole))
    size = fft.next_fast_len(max(int(2 * whole * per_turn), 1), real=True)
    cells = np.bincount(((at - at.min()) * per_turn).astype(np.int64), values, size)
    power = np.abs(fft.rfft(cells)) ** 2
    order = np.arange(power.size) * per_turn / size
    lowest, highest = max(LOWEST_ORDER, FEWEST_WAVES / whole), min(MAX_HARMONIC, per_turn / CELLS_PER_PERIOD)
    tried = (order >= lowest) & (order <= highest)
    power, order = power[tried], order[tried]
    near = min(BACKGROUND_ORDERS, power.size // FEWEST_BLOCKS)
    if near == 0:
        return power[:0], order[:0]
    blocks = power[: power.size - power.size % near].reshape(-1, near)
    middle = (np.arange(len(blocks)) + 0.5) * near
    # The median of an exponential distribution is log 2 times its mean.
    around = np.interp(np.arange(power.size), middle, np.median(blocks, axis=1) / np.log(2.0))
    return power / np.maximum(around, TINY), order


def _at_all_speeds(problem: Problem, values: FloatArray, at: FloatArray, order: float) -> bool:
    """Return whether the line has a similar amplitude and the same phase at low and at high speeds."""
    slow = problem.speed <= np.median(problem.speed)
    both = _fourier_sum(values, at, order) / at.size
    parts = [_fourier_sum(values[part], at[part], order) / max(int(part.sum()), 1) for part in (slow, ~slow)]
    return all((part * np.conj(both)).real >= SAME_SHARE * abs(both) ** 2 for part in parts)


# ---- drift of the integrated angle, by the phase of a torque ripple --------------------------------------------------
# The angle of the wheel is the integral of a noisy speed: its error is a random walk, which reaches one radian of the
# phase of a harmonic after `coherent_slots` (docs/effects/torque_ripple.md). Within shorter blocks a harmonic is still
# coherent. The phases of the blocks, smoothed under the random walk caused by the noise of the speed, give the drift;
# corrected for it, the ripple is coherent over the whole record.


ComplexArray = NDArray[np.complex128]

BLOCKS_PER_COHERENCE: Final = 8  # the phase drifts by 1/√8 rad within a block
SHORTEST_BLOCK: Final = 32  # slots: in shorter blocks a line does not stand out from the noise
MOST_BLOCKS: Final = 16  # blocks, up to which the time offset of friction from speed is estimated
OVERSAMPLING: Final = 8  # time offsets that are tried within the width of a peak
DRIFT_THRESHOLD: Final = 8.0  # standard deviations of the blocks' power above noise, for the best of 48 harmonics


def with_angle_drift(problem: Problem, base: Fit) -> Problem:
    """Return the problem with the drift of each record's angle, where a ripple makes it observable.

    Parameters
    ----------
    problem
        The data.
    base
        A fit whose residual contains the ripple.
    """
    residuals = problem.spread(base.residual * problem.sign, 0.0)
    variance = max(problem.noise.long_run_variance, base.rss / problem.z.size)  # samples that no level fits count, too
    drifts = [
        track_drift(record, residual, variance) for record, residual in zip(problem.records, residuals, strict=True)
    ]
    if all(drift is None for drift in drifts):
        return problem
    records = [replace(one, angle_drift_rad=drift) for one, drift in zip(problem.records, drifts, strict=True)]
    return replace(problem, records=tuple(records))


def track_drift(record: Record, residual_Nm: FloatArray, variance: float) -> FloatArray | None:
    """Return the drift of the angle, float64 (n,) [rad]; None if no ripple is significant or the angle is measured.

    It includes the angle that the wheel turns during `time_between`.

    Parameters
    ----------
    record
        The record, with its speed and the noise of the speed.
    residual_Nm
        float64 (n,), residual torque of a model on the slots, 0 where unknown [N m].
    variance
        Upper bound of the variance of the residual's noise at any frequency [N² m²].
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
        length = _block_length(harmonic, record)
        if 2 * length > residual_Nm.size:
            continue
        edges = np.arange(0, residual_Nm.size, length)
        sums = np.add.reduceat(residual_Nm * np.exp(-1j * harmonic * angle), edges)
        count = np.add.reduceat(counted, edges)
        filled = count > 0
        power = 2.0 * np.abs(sums[filled]) ** 2 / (count[filled] * variance)  # χ² with two degrees, twice a mean of 1
        excess = float(np.sum(power - 2.0) / np.sqrt(4.0 * power.size))
        if excess > DRIFT_THRESHOLD:
            sure.append((excess, harmonic, length, sums, count))
    if not sure:
        return moved if later_s else None
    _, harmonic, length, sums, count = max(sure, key=lambda one: one[0])
    step = harmonic * record.speed_noise_rad_s * channels.sample_period_s
    phase = smooth_phase(sums, count * variance / 2.0, step**2 * length)
    middle = np.minimum(np.arange(sums.size) * length + 0.5 * length, residual_Nm.size)
    return np.asarray(moved + np.interp(np.arange(residual_Nm.size), middle, phase) / harmonic)


def time_between(record: Record, residual_Nm: FloatArray) -> float:
    """Return how much later friction is read than the speed [s], from the phase of a ripple; 0 if not significant.

    With such an offset the phase of a harmonic is proportional to the speed: over an even grid of the speed it is a
    spectral line at the offset, which is searched up to one sample period either way. Its power is summed over blocks
    in which the phase drifts little.

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
        blocks = -(-speed.size // _block_length(harmonic, record))
        if blocks > MOST_BLOCKS:
            break
        cell = np.pi / (2.0 * harmonic * period_s)
        at = ((speed - speed.min()) / cell).astype(np.int64)
        size = fft.next_fast_len(OVERSAMPLING * (int(at.max()) + 1))
        at += np.arange(speed.size) * blocks // speed.size * size
        turned = residual_Nm * np.exp(-1j * harmonic * angle)
        cells = np.bincount(at, turned.real, blocks * size) + 1j * np.bincount(at, turned.imag, blocks * size)
        power = np.sum(np.abs(fft.fft(cells.reshape(blocks, size))) ** 2, axis=0)
        # The power of noise is a sum of `blocks` exponential variables: its median is 1/3 of one's mean below its mean.
        power /= max(total / blocks, float(np.median(power)) / (blocks - 1.0 / 3.0), TINY)
        times_s = 2.0 * np.pi * fft.fftfreq(size, cell) / harmonic
        within = np.flatnonzero(np.abs(times_s) <= period_s)
        best = within[np.argmax(power[within])]
        tried += within.size
        gained = float(power[best] - power[0]) / np.sqrt(blocks)
        if gained > found:
            found, later_s = gained, float(times_s[best])
    return later_s if found > LINE_THRESHOLD + np.log(tried) else 0.0


def _block_length(harmonic: int, record: Record) -> int:
    """Return the number of slots over which the phase of a harmonic drifts little."""
    coherent = coherent_slots(harmonic, record.speed_noise_rad_s, record.channels.sample_period_s)
    return max(coherent // BLOCKS_PER_COHERENCE, SHORTEST_BLOCK)


def smooth_phase(sums: ComplexArray, noise: FloatArray, walk: float) -> FloatArray:
    """Smooth the phases of complex sums that drift as a random walk (Rauch, Tung and Striebel, AIAA J. 3, 1965).

    Parameters
    ----------
    sums
        complex128 (m,), sum of each block [N m].
    noise
        float64 (m,), variance of each quadrature of a sum [N² m²].
    walk
        Variance of the change of phase from one block to the next [rad²].

    Returns
    -------
    FloatArray
        float64 (m,) [rad], unwrapped.
    """
    amplitude2 = max(float(np.sum(np.abs(sums) ** 2 - 2.0 * noise)) / max(sums.size, 1), TINY)
    spread = np.maximum(noise, 1e-3 * amplitude2) / amplitude2  # variance of a phase, to first order
    first = int(np.argmax(np.abs(sums)))
    mean, variance = np.empty(sums.size), np.empty(sums.size)
    for order in (range(first, sums.size), range(first, -1, -1)):  # outwards from the block with the largest sum
        at, uncertainty = float(np.angle(sums[first])), float(spread[first])
        for k in order:
            if k != first:
                uncertainty += walk
                turn = float(np.angle(sums[k] * np.exp(-1j * at)))  # wrapped to half a turn either way
                gain = uncertainty / (uncertainty + float(spread[k]))
                at, uncertainty = at + gain * turn, (1.0 - gain) * uncertainty
            mean[k], variance[k] = at, uncertainty
    inwards = [(k, k + 1) for k in range(sums.size - 2, first - 1, -1)] + [(k, k - 1) for k in range(1, first + 1)]
    for k, later in inwards:
        mean[k] += variance[k] / (variance[k] + walk) * (mean[later] - mean[k])
    return mean
