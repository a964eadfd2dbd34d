"""A wheel beside its siblings: whether what moved moved in all of a spacecraft's wheels, or in one.

Wheels of one spacecraft share temperature, slews, bus voltage and software. A coefficient of each is compared with what
it was: the relative shift r of the latest window against the median of earlier nominal ones. Under each hypothesis the
shifts are jointly Gaussian, with variance S² in what moved:

    nothing moved          r ~ N(0, D)                       D: the windows' own errors and the wheels' own wander
    a cause they share     r ~ N(0, D + S² 1 1ᵀ)
    wheel i alone          r ~ N(0, D + S² eᵢ eᵢᵀ)
    both                   r ~ N(0, D + S² (1 1ᵀ + eᵢ eᵢᵀ))

Bayes' rule weighs them. Two wheels cannot be told from one cause and one exception: three are needed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.history.alarms import WINDOW_POLICY
from rwa_monitor.kernels.noise import CHI_MEDIAN
from rwa_monitor.samples import BoolArray, FloatArray

COMPARED: Final = {"dry": "base dry friction", "viscous": "viscous friction"}  # coefficients, and their names in words
FEWEST_WHEELS: Final = 3
MOST_WHEELS: Final = 16  # more are no siblings, but a fleet under one name
SURE: Final = 0.95  # probability from which a shift counts as shared, or as of one wheel alone
FEWEST_EARLIER: Final = 5  # windows that a wheel is compared with; with fewer, with what is nominal
LATEST: Final = WINDOW_POLICY.n  # windows that are left out of what it was: those of which an alarm is made
MOST_EARLIER: Final = 48  # windows; four days of 2.2 hours each
SHIFT_STD: Final = 0.2  # S, one standard deviation of a shift where there is one; the learned anomalies are 15 to 30 %
BOUNDS_APART: Final = 4.0  # standard deviations of healthy wheels between the nominal bounds, that is ±2
LEAST_WANDER: Final = 0.005  # of a wheel's own coefficient from window to window, one standard deviation
PRIOR_COMMON: Final = 0.05  # probability that a cause they share moved the latest windows
PRIOR_ALONE: Final = 0.02  # the same of each wheel by itself


class Shift(NamedTuple):
    """By how much a coefficient of one wheel moved, relative to what it was.

    Attributes
    ----------
    value, variance
        The shift, and its variance [-].
    nominal
        Half the width of what is nominal, relative to what it was [-].
    """

    value: float
    variance: float
    nominal: float


class Comparison(NamedTuple):
    """What the shifts of siblings show.

    Attributes
    ----------
    common
        Probability that a cause which they share moved them.
    shift, shift_std
        The shift that they share, if they do [-].
    alone
        float64 (wheels,), probability that each moved by itself, beside what they share.
    """

    common: float
    shift: float
    shift_std: float
    alone: FloatArray


def shift_of(values: FloatArray, stds: FloatArray, anomalous: BoolArray, nominal: tuple[float, float]) -> Shift | None:
    """Return the shift of the latest of a wheel's windows; None where that window does not show the coefficient.

    Parameters
    ----------
    values, stds
        float64 (windows,), the coefficient in each window, the oldest first, and its standard deviation; NaN where a
        window does not show it.
    anomalous
        bool (windows,), where it was judged anomalous: such windows do not become what it was.
    nominal
        Bounds of what is nominal; the wheel is compared with their middle where there are too few earlier windows.
    """
    latest, std = float(values[-1]), float(stds[-1])
    if not np.isfinite(latest + std):
        return None
    earlier = values[:-LATEST][~anomalous[:-LATEST] & np.isfinite(values[:-LATEST])]
    if earlier.size >= FEWEST_EARLIER:
        was = float(np.median(earlier))
        wander = max(float(np.median(np.abs(earlier - was))) / math.sqrt(CHI_MEDIAN), LEAST_WANDER * was)
        # The median of n windows has π/2 times the variance of their mean.
        variance = wander**2 * (1.0 + 0.5 * np.pi / earlier.size)
    else:
        was, variance = 0.5 * sum(nominal), ((nominal[1] - nominal[0]) / BOUNDS_APART) ** 2
    if not was > 0.0:  # NaN too: neither earlier windows nor bounds
        return None
    return Shift(latest / was - 1.0, (std**2 + variance) / was**2, 0.5 * (nominal[1] - nominal[0]) / was)


def compare(shifts: Sequence[Shift]) -> Comparison | None:
    """Weigh the hypotheses; None with fewer than three wheels."""
    count = len(shifts)
    if count < FEWEST_WHEELS:
        return None
    r = np.array([shift.value for shift in shifts])
    # A hypothesis a row: whether a cause that all share moved them, and which wheel moved by itself.
    shared = np.repeat([False, True], count + 1)
    alone = np.tile(np.vstack([np.zeros(count), np.eye(count)]), (2, 1))
    moved = shared[:, None, None] + alone[:, :, None] * alone[:, None, :]
    covariance = np.diag([shift.variance for shift in shifts]) + SHIFT_STD**2 * moved
    inverse = np.linalg.inv(covariance)
    prior = np.where(shared, np.log(PRIOR_COMMON), np.log(1.0 - PRIOR_COMMON))
    prior += np.where(alone.any(axis=1), np.log(PRIOR_ALONE), np.log(1.0 - count * PRIOR_ALONE))
    log_weight = prior - 0.5 * (r @ inverse @ r + np.linalg.slogdet(covariance)[1])
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    # The shift that they share, given the shifts.
    gain = SHIFT_STD**2 * inverse[shared].sum(axis=1)
    means, variances = gain @ r, SHIFT_STD**2 * (1.0 - gain.sum(axis=1))
    common = float(weight[shared].sum())
    of_these = weight[shared] / max(common, np.finfo(float).tiny)
    shift = float(of_these @ means)
    variance = float(of_these @ (variances + (means - shift) ** 2))
    return Comparison(common, shift, float(np.sqrt(max(variance, 0.0))), weight @ alone)


class Moved(NamedTuple):
    """How a coefficient of one wheel moved beside its siblings.

    Attributes
    ----------
    is_common, is_alone
        Whether a cause that all share moved it, or it moved by itself; neither where it stayed, or that is not certain.
    is_large
        Whether what all share moved it by more than lies between the middle and a bound of what is nominal.
    in_words
        One sentence for an operator.
    """

    is_common: bool
    is_alone: bool
    is_large: bool
    in_words: str


def moved(name: str, wheel: str, shifts: Mapping[str, Shift]) -> Moved | None:
    """Judge a wheel beside its siblings, by the shifts of all; None where they are too few, or it has none.

    Parameters
    ----------
    name
        Of the coefficient, one of `COMPARED`.
    wheel
        Which of the wheels is judged.
    shifts
        By wheel.
    """
    if wheel not in shifts:
        return None
    names = sorted(shifts)
    found = compare([shifts[one] for one in names])
    if found is None:
        return None
    alone = float(found.alone[names.index(wheel)]) >= SURE
    if alone or found.common < SURE:
        own = shifts[wheel]
        words = (
            f"{COMPARED[name].capitalize()} moved by {_percent(own.value, own.variance**0.5)}, apart from that of the "
            f"other {len(names) - 1} wheels."
        )
        return Moved(is_common=False, is_alone=alone, is_large=False, in_words=words)
    words = (
        f"{COMPARED[name].capitalize()} of all {len(names)} wheels moved by {_percent(found.shift, found.shift_std)}: "
        "a cause outside the wheels, such as temperature, the supply of the current sensors, or a change of software."
    )
    large = abs(found.shift) > float(np.median([shift.nominal for shift in shifts.values()]))
    return Moved(is_common=True, is_alone=False, is_large=large, in_words=words)


def _percent(value: float, std: float) -> str:
    return f"{100.0 * value:+.1f} ± {100.0 * std:.1f} %"
