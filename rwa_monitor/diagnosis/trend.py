"""The history of a friction coefficient from window to window: whether it grows, and when it will reach a limit.

The model: constant up to an unknown onset, from there on a steady slope. Deviations from it are the estimates' own
errors; a scatter that their standard deviations do not include and that persists from one window to the next
(temperature, lubricant), AR(1) with unknown size and memory; and an occasional gross error, as when a whole jump was
assigned to the wrong part. The first two enter by their covariance, on a grid of sizes and memories weighted by the
restricted likelihood of the data; so an autocorrelated scatter, which mimics a trend, raises the p-value and widens the
interval as it should. Gross errors are down-weighted first, by Student's t.

Without a trend, the largest standardised slope over all onsets exceeds c with a probability of at most

    2 Φ(-c) + L/π · exp(-c²/2),

where L is the length of the curve that the normalised regressors draw on the sphere (R. B. Davies, "Hypothesis testing
when a nuisance parameter is present only under the alternative", Biometrika 74, 1987). No random numbers are needed.
"""

from typing import Final, NamedTuple

import numpy as np
from scipy import linalg, special

from rwa_monitor.errors import InputError
from rwa_monitor.samples import FloatArray

SIGNIFICANCE: Final = 1e-3  # p-value below which a trend is announced: it is tested anew at every window
MIN_WINDOWS: Final = 8  # for a line, its onset, and the scatter around it
MAX_WINDOWS: Final = 300  # the newest are used; at 2.2 hours each that is four weeks
ONSETS: Final = 48  # onsets that are tried, evenly over the time
LAST_TESTED: Final = 5  # windows that a tested onset has after it, at least: fewer may be gross errors in a row
DEGREES_OF_FREEDOM: Final = 2.0  # of Student's t: a gross error of dry friction, a whole jump, is 50 std
ROUNDS: Final = 12  # of reweighting
SCATTERS: Final = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # in units of the median standard deviation of the estimates
MEMORIES: Final = (0.0, 0.7, 0.9, 0.95, 0.98, 0.99)  # correlation of the scatter from one window to the next
QUANTILES: Final = (0.025, 0.5, 0.975)  # of a 95 % interval
FARTHEST: Final = 1e3  # times the span of the data; a limit beyond is never reached


class Reach(NamedTuple):
    """When the line reaches a limit [s], on the clock of the times given; infinite where it may never.

    Attributes
    ----------
    limit
        The limit, in the unit of the values.
    time_s, low_s, high_s
        Median and 95 % interval.
    """

    limit: float
    time_s: float
    low_s: float
    high_s: float


class Lines(NamedTuple):
    """The posterior of the line, a mixture: for each onset and covariance a weight and a normal law of level and slope.

    Attributes
    ----------
    now_s, span_s
        Time of the last window, and of all [s].
    weight, onset_s
        float64 (lines,), weights with sum 1, and onsets [s].
    mean, covariance
        float64 (lines, 2) and (lines, 2, 2), of the level before the onset and the slope after it.
    """

    now_s: float
    span_s: float
    weight: FloatArray
    onset_s: FloatArray
    mean: FloatArray
    covariance: FloatArray

    def each_at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance of every line at every time, float64 (lines, n)."""
        since = np.maximum(time_s - self.onset_s[:, None], 0.0)
        v = self.covariance
        variance = v[:, :1, 0] + 2.0 * v[:, 0, 1:] * since + v[:, 1, 1:] * since**2
        return self.mean[:, :1] + self.mean[:, 1:] * since, variance

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation over all lines at every time [s], float64 (n,)."""
        mean, variance = self.each_at(np.asarray(time_s, dtype=np.float64))
        centre = self.weight @ mean
        return centre, np.sqrt(self.weight @ (variance + (mean - centre) ** 2))

    def beyond(self, time_s: float, limit: float, side: int) -> float:
        """Return the probability that the line lies above (side 1) or below (-1) a limit at a time."""
        mean, variance = self.each_at(np.array([time_s]))
        return float(self.weight @ special.ndtr(side * (mean[:, 0] - limit) / np.sqrt(variance[:, 0])))

    def crossing(self, limit: float, side: int, share: float) -> float:
        """Return the time by which a limit is passed with probability `share` [s]; infinite if never."""
        far = self.now_s + FARTHEST * self.span_s
        if self.beyond(self.now_s, limit, side) >= share:
            return self.now_s
        if self.beyond(far, limit, side) < share:
            return float("inf")
        from scipy import optimize

        return float(optimize.brentq(lambda t: self.beyond(t, limit, side) - share, self.now_s, far))


class Trend(NamedTuple):
    """Result of the search for a trend of one coefficient over many windows.

    Attributes
    ----------
    windows
        Windows used.
    p_value
        Upper bound of the probability of such a slope where there is no trend.
    slope, slope_std
        Change per second since the onset.
    onset_s
        Onset [s]: 2.5 %, 50 % and 97.5 % quantile, resolved to the grid of `ONSETS`.
    value
        Mean of the line at the last window.
    lines
        The distribution that all of this comes from; `lines.at(time_s)` is the line to draw.
    """

    windows: int
    p_value: float
    slope: float
    slope_std: float
    onset_s: tuple[float, float, float]
    value: float
    lines: Lines

    @property
    def present(self) -> bool:
        """Whether there is a trend at the level `SIGNIFICANCE`."""
        return self.p_value < SIGNIFICANCE

    def reach(self, limit: float) -> Reach | None:
        """Return when the line reaches a limit, in the unit of the values.

        Where the line is beyond it already, all three times are that of the last window. None without a trend, and
        where the trend leads away from the limit.
        """
        side = 1 if self.slope > 0 else -1
        if not self.present:
            return None
        now = self.lines.now_s
        if side * (self.value - limit) >= 0:
            return Reach(limit, now, now, now)
        low, median, high = (self.lines.crossing(limit, side, share) for share in QUANTILES)
        return Reach(limit, median, low, high)


def find_trend(time_s: FloatArray, value: FloatArray, std: FloatArray) -> Trend | None:
    """Look for a trend in the estimates of many windows of a wheel.

    Parameters
    ----------
    time_s
        float64 (n,), middle of each window, ascending; any clock.
    value, std
        float64 (n,), estimates and their standard deviations, one unit; NaN in either where a window has none.

    Returns
    -------
    Trend, or None where fewer than `MIN_WINDOWS` windows have an estimate.

    Raises
    ------
    InputError
        If lengths differ, times do not ascend, or a standard deviation is not positive.
    """
    time_s, value, std = (np.asarray(each, dtype=np.float64) for each in (time_s, value, std))
    if not time_s.shape == value.shape == std.shape or time_s.ndim != 1:
        raise InputError("trend", f"times {time_s.shape}, values {value.shape} and deviations {std.shape} differ")
    seen = np.isfinite(value) & np.isfinite(std)
    time_s, value, std = (each[seen][-MAX_WINDOWS:] for each in (time_s, value, std))
    if (np.diff(time_s) <= 0).any() or (std <= 0).any():
        raise InputError("trend", "times must ascend, and standard deviations be positive")
    if time_s.size < MIN_WINDOWS:
        return None
    # Below, time is a share of the span and values are in median standard deviations: nothing over- or underflows.
    span_s, middle, scale = float(time_s[-1] - time_s[0]), float(np.median(value)), float(np.median(std))
    at, y = (time_s - time_s[0]) / span_s, (value - middle) / scale
    onsets = np.linspace(0.0, at[-2], ONSETS)  # at least one window after each
    hinges = np.maximum(at - onsets[:, None], 0.0)
    variance = _raised_for_gross_errors(at, hinges, y, (std / scale) ** 2)
    cells = [(0.0, 0.0), *((scatter, memory) for scatter in SCATTERS[1:] for memory in MEMORIES)]
    tested = int(np.count_nonzero(onsets <= at[-1 - LAST_TESTED]))
    fits = (_fit(at, hinges, tested, y, variance, scatter, memory) for scatter, memory in cells)
    log_likelihood, mean, covariance, p_value = map(np.array, zip(*fits, strict=True))
    weight = np.exp(log_likelihood - log_likelihood.max())
    weight /= weight.sum()
    units = np.array([scale, scale / span_s])
    lines = Lines(
        now_s=float(time_s[-1]),
        span_s=span_s,
        weight=weight.ravel(),
        onset_s=np.tile(time_s[0] + span_s * onsets, len(cells)),
        mean=mean.reshape(-1, 2) * units + [middle, 0.0],
        covariance=covariance.reshape(-1, 2, 2) * np.outer(units, units),
    )
    now, _ = lines.at(time_s[-1:])
    slope = float(lines.weight @ lines.mean[:, 1])
    return Trend(
        windows=at.size,
        p_value=float(min(weight.sum(axis=1) @ p_value, 1.0)),
        slope=slope,
        slope_std=float(np.sqrt(lines.weight @ (lines.covariance[:, 1, 1] + (lines.mean[:, 1] - slope) ** 2))),
        onset_s=_quantiles(time_s[0] + span_s * onsets, weight.sum(axis=0)),
        value=float(now[0]),
        lines=lines,
    )


def _quantiles(values: FloatArray, weight: FloatArray) -> tuple[float, float, float]:
    """Return the `QUANTILES` of ascending values with weights."""
    low, median, high = np.searchsorted(np.cumsum(weight), QUANTILES).clip(max=values.size - 1)
    return float(values[low]), float(values[median]), float(values[high])


# ---- gross errors ----------------------------------------------------------------------------------------------------


def _raised_for_gross_errors(at: FloatArray, hinges: FloatArray, y: FloatArray, variance: FloatArray) -> FloatArray:
    """Return the variances, increased for gross errors.

    For each onset and size of the scatter a line is fitted under Student's t by iterative reweighting; the likeliest of
    them decides which residuals are gross.
    """
    scatter = np.square(SCATTERS)[None, :, None]
    total = variance + scatter  # (1, scatters, n)
    h = hinges[:, None, :]
    weight = np.ones((hinges.shape[0], len(SCATTERS), y.size)) / total
    square = np.zeros_like(weight)
    slope = np.zeros((*square.shape[:2], 1))
    for _ in range(ROUNDS):
        level, slope = _weighted_line(h, y, weight)
        square = (y - level - slope * h) ** 2 / total
        weight = (DEGREES_OF_FREEDOM + 1.0) / (DEGREES_OF_FREEDOM + square) / total
    # Of Student's t, without the constants common to all.
    log_density = -0.5 * (DEGREES_OF_FREEDOM + 1.0) * np.log1p(square / DEGREES_OF_FREEDOM) - 0.5 * np.log(total)
    best = np.unravel_index(int(np.argmax(log_density.sum(axis=-1))), square.shape[:2])
    excess = np.maximum((DEGREES_OF_FREEDOM + square[best]) / (DEGREES_OF_FREEDOM + 1.0) - 1.0, 0.0)
    growth = slope[best] * np.gradient(at) * (hinges[best[0]] > 0)
    return np.asarray(variance + excess * total[0, best[1]] + growth**2 / 12.0)


def _weighted_line(h: FloatArray, y: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return level and slope of weighted least squares on [1, h], along the last axis, which stays with length 1."""
    total = weight.sum(axis=-1, keepdims=True)
    h_mean = (weight * h).sum(axis=-1, keepdims=True) / total
    y_mean = (weight * y).sum(axis=-1, keepdims=True) / total
    slope = (weight * (h - h_mean) * (y - y_mean)).sum(axis=-1, keepdims=True)
    slope /= (weight * (h - h_mean) ** 2).sum(axis=-1, keepdims=True)
    return y_mean - slope * h_mean, slope


# ---- lines under one size and memory of the scatter ------------------------------------------------------------------


def _fit(
    at: FloatArray,
    hinges: FloatArray,
    tested: int,
    y: FloatArray,
    variance: FloatArray,
    scatter: float,
    memory: float,
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Fit a line for each onset by generalised least squares, and test the slopes of the first `tested`.

    Returns restricted log-likelihoods, float64 (onsets,), means and covariances of level and slope, (onsets, 2) and
    (onsets, 2, 2), and the p-value of the test.
    """
    steps = np.abs(at[:, None] - at) / np.median(np.diff(at))
    covariance = np.diag(variance) + scatter**2 * memory**steps
    root = np.linalg.cholesky(covariance)
    white = linalg.solve_triangular(root, np.column_stack([y, np.ones_like(y), hinges.T]), lower=True)
    y_white, one, h = white[:, 0], white[:, 1], white[:, 2:]
    # With the level projected out, each hinge is one direction, and its slope a single projection.
    mean_y, mean_h = (one @ y_white) / (one @ one), (one @ h) / (one @ one)
    y_free, h_free = y_white - mean_y * one, h - mean_h * one[:, None]
    norm = np.linalg.norm(h_free, axis=0)
    projection = (y_free @ h_free) / norm
    slope = projection / norm
    slope_variance = 1.0 / norm**2
    covariances = np.empty((norm.size, 2, 2))
    covariances[:, 0, 0] = 1.0 / (one @ one) + mean_h**2 * slope_variance
    covariances[:, 0, 1] = covariances[:, 1, 0] = -mean_h * slope_variance
    covariances[:, 1, 1] = slope_variance
    # Level and rise since the onset are integrated out under flat priors; the rise, not the slope, so that a late onset
    # does not become likelier for the steep lines it allows.
    log_likelihood = (
        -np.log(np.diag(root)).sum()
        - 0.5 * np.log(one @ one)
        - np.log(norm / hinges[:, -1])
        - 0.5 * (y_free @ y_free - projection**2)
    )
    direction = (h_free / norm)[:, :tested]
    length = float(np.arccos(np.clip((direction[:, 1:] * direction[:, :-1]).sum(axis=0), -1.0, 1.0)).sum())
    highest = float(np.abs(projection[:tested]).max())
    bound = 2.0 * special.ndtr(-highest) + length / np.pi * np.exp(-0.5 * highest**2)
    return log_likelihood, np.column_stack([mean_y - slope * mean_h, slope]), covariances, float(min(bound, 1.0))
