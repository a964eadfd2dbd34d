"""How far the integrated angle has drifted: tracked by the phase of a torque ripple, where there is one.

The angle of the wheel is the integral of a noisy speed: its error is a random walk, and after `coherent_slots` the
phase of a harmonic is lost by a radian (docs/effects/torque_ripple.md). Over blocks shorter than
that a harmonic is a line still; the phases of the blocks, smoothed by the random walk that the speed's noise makes,
give the drift, and with it the ripple is coherent over the whole record.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rwa_monitor.discrepancy.base_fit import Fit
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import Record
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.torque_ripple import MAX_HARMONIC, angle_turned, coherent_slots

ComplexArray = NDArray[np.complex128]

BLOCKS_PER_COHERENCE: Final = 8  # the phase wanders by 1/√8 rad within a block
SHORTEST_BLOCK: Final = 32  # slots: shorter sums hold too little of a line
SURE: Final = 8.0  # standard deviations of the blocks' power above noise, the best of 48 harmonics


def with_angle_drift(problem: Problem, base: Fit) -> Problem:
    """Return the problem with the drift of each record's angle, where a ripple shows it.

    Parameters
    ----------
    problem
        The data.
    base
        A fit whose residual holds the ripple.
    """
    records, known = [], False
    for index, record in enumerate(problem.records):
        begin, end = int(problem.starts[index]), int(problem.starts[index + 1])
        residual = np.zeros(record.used.size)
        residual[problem.slot[begin:end]] = (base.residual * problem.sign)[begin:end]
        drift = track_drift(record, residual, problem.noise.long_run_variance)
        known |= drift is not None
        records.append(record if drift is None else replace(record, angle_drift_rad=drift))
    return replace(problem, records=tuple(records)) if known else problem


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
    angle, _ = angle_turned(channels)
    counted = (residual_Nm != 0.0).astype(np.float64)
    best: tuple[float, int, int, ComplexArray, FloatArray] | None = None
    for harmonic in range(1, MAX_HARMONIC + 1):
        coherent = coherent_slots(harmonic, record.speed_noise_rad_s, channels.sample_period_s)
        length = max(coherent // BLOCKS_PER_COHERENCE, SHORTEST_BLOCK)
        if 2 * length > residual_Nm.size:
            continue
        edges = np.arange(0, residual_Nm.size, length)
        sums = np.add.reduceat(residual_Nm * np.exp(-1j * harmonic * angle), edges)
        count = np.add.reduceat(counted, edges)
        filled = count > 0
        power = 2.0 * np.abs(sums[filled]) ** 2 / (count[filled] * variance)  # χ² with two degrees, twice a mean of 1
        excess = float(np.sum(power - 2.0) / np.sqrt(4.0 * power.size))
        if excess > SURE and (best is None or excess > best[0]):
            best = (excess, harmonic, length, sums, count)
    if best is None:
        return None
    _, harmonic, length, sums, count = best
    step = harmonic * record.speed_noise_rad_s * channels.sample_period_s
    phase = smooth_phase(sums, count * variance / 2.0, step**2 * length)
    middle = np.minimum(np.arange(sums.size) * length + 0.5 * length, residual_Nm.size)
    return np.asarray(np.interp(np.arange(residual_Nm.size), middle, phase) / harmonic)


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
    amplitude2 = max(float(np.sum(np.abs(sums) ** 2 - 2.0 * noise)) / max(sums.size, 1), 1e-300)
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
