"""The paper's method as one would write it from the paper, in plain numpy and Python: the peer of whole windows.

One scale, cumulative sums, the maximum of each run above the threshold (IV-A); least squares by the matrix H as it is
printed (IV-B); the dynamic programme in Python (IV-C); Algorithm 1; one linear classifier per anomaly (IV-D). Errata
are mended as in `--method paper`, whose dynamic programme, plain Python too, is used here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import special

from rwa_monitor.diagnosis.model import Model, models_for
from rwa_monitor.diagnosis.paper_classification import decide
from rwa_monitor.paper.assignment import most_likely_jumps
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.wheel.wheel import Wheel

SCALE: Final = 50  # w
WEIGHT: Final = 1e-4  # W_b
FALSE_ALARMS: Final = 1e-9  # of a sample


@dataclass(frozen=True, slots=True)
class PlainDiagnosis:
    """What the method says of a window, normalised: changepoints, who made each, base dry and viscous friction."""

    changepoints: IntArray
    system: tuple[int, ...] | None
    base_dry: float
    viscous: float
    active: tuple[bool, ...]


def wglr(x: FloatArray, z: FloatArray, w: int = SCALE, weight: float = WEIGHT, slope: float = 1.0) -> FloatArray:
    """Return the wGLR at one scale, unnormalised, at the slots w … n - w; float64 (n - 2w + 1,).

    Parameters
    ----------
    x, z
        float64 (n,), normalised speed and friction.
    w, weight, slope
        The scale, W_b and f̃_v.
    """
    e = z - slope * x
    sums = [np.concatenate(([0.0], np.cumsum(v))) for v in (x, e, x * x, x * e, e * e)]
    k = np.arange(w, x.size - w + 1)

    def squared_error(parts: list[tuple[IntArray, IntArray]]) -> FloatArray:
        sxx, sxe, see = np.full(k.size, weight), np.zeros(k.size), np.zeros(k.size)
        for a, b in parts:
            sx, se, xx, xe, ee = (s[b] - s[a] for s in sums)
            n = b - a
            sxx, sxe, see = sxx + xx - sx * sx / n, sxe + xe - sx * se / n, see + ee - se * se / n
        return np.asarray(see - sxe * sxe / sxx)

    return squared_error([(k - w, k + w)]) - squared_error([(k - w, k), (k, k + w)])


def threshold() -> float:
    """Return the threshold of the normalised statistic."""
    return float(special.chdtri(1, FALSE_ALARMS))


def changepoints(x: FloatArray, z: FloatArray, std: float) -> IntArray:
    """Return the maximum of each contiguous run above the threshold, int64 (changepoints,); `std` is the noise's."""
    statistic = np.pad(wglr(x, z) / std**2, (SCALE, SCALE - 1))
    above = np.concatenate(([False], statistic > threshold(), [False]))
    edges = np.flatnonzero(np.diff(above.astype(np.int8)))
    return np.array([a + np.argmax(statistic[a:b]) for a, b in edges.reshape(-1, 2)], dtype=np.int64)


def levels_of(x: FloatArray, z: FloatArray, index: IntArray) -> tuple[FloatArray, float, FloatArray]:
    """Return each interval's level, the viscous coefficient, and each interval's samples, by least squares."""
    interval = np.searchsorted(index, np.arange(x.size), side="right")
    near = np.zeros(x.size, dtype=np.bool_)
    edges = np.concatenate(([0], index, [x.size]))
    for before, at, after in zip(edges[:-2], edges[1:-1], edges[2:], strict=True):
        # w/2 around each, as the paper says, but of a short interval at most two thirds: else it has no sample left.
        near[at - min(SCALE // 2, (at - before) // 3) : at + min(SCALE // 2, (after - at) // 3)] = True
    used = np.flatnonzero(~near)
    h = np.zeros((used.size, index.size + 2))
    h[np.arange(used.size), interval[used]] = 1.0
    h[:, -1] = x[used]
    normal = h.T @ h
    solution = np.linalg.solve(normal, h.T @ z[used])
    return np.asarray(solution[:-1], dtype=np.float64), float(solution[-1]), np.diag(normal)[:-1]


def diagnose(speed_rad_s: FloatArray, torque_Nm: FloatArray, wheel: Wheel, model: Model, std: float) -> PlainDiagnosis:
    """Diagnose one window.

    Parameters
    ----------
    speed_rad_s, torque_Nm
        float64 (slots,), all good: the paper knows no gaps.
    wheel, model
        The wheel, and the classifiers that were learned for it.
    std
        Standard deviation of the noise, normalised.
    """
    moving = np.abs(speed_rad_s) >= (wheel.window.dead_band_rad_s or 0.0)
    x = np.abs(speed_rad_s[moving]) / wheel.speed_unit_rad_s
    z = np.sign(speed_rad_s[moving]) * torque_Nm[moving] / wheel.torque_unit_Nm
    found = changepoints(x, z, std)
    level, viscous, samples = levels_of(x, z, found)
    step = np.diff(level)
    n = np.maximum(samples, 1.0)
    merged = 0.5 * n[:-1] * n[1:] / (n[:-1] + n[1:]) * step**2 / std**2
    direction = np.where(step >= 0, 1, -1)
    place = np.flatnonzero(moving)[found]
    choices, *_ = most_likely_jumps(wheel.fss, place, direction, np.log(FALSE_ALARMS) - merged)
    base, values = float(level[0]), []
    for s in range(len(wheel.fss)):
        mine = [k for k, who in enumerate(choices or ()) if who == s]
        friction = np.concatenate([[0.0], np.cumsum(step[mine])])
        base += float(friction.min())
        values.append(friction - friction.min())
    nominal = wheel.nominal.viscous_Nm_s_rad * wheel.speed_unit_rad_s / wheel.torque_unit_Nm if wheel.nominal else 1.0
    features = [np.array([base]), np.array([viscous / nominal]), *values]
    active = tuple(
        known is not None and known.svm is not None and decide(known.svm, value)[0] > 0
        for known, value in zip(models_for(wheel, model), features, strict=True)
    )
    return PlainDiagnosis(place, choices, base, viscous, active)
