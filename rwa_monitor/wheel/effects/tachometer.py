"""Errors of a tachometer: its readings are quantised, and near zero it reads no motion at all."""

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.kernels.noise import CHI_MEDIAN
from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.wheel.effects.base import Channels, LikelihoodFit, MeanEffect, NoiseEffect, Parameter, Shape

FEWEST_RESTS: Final = 25.0  # readings that rest while the wheel moves: probability 3e-8 by chance
FEWEST_HELD: Final = 4  # equal readings in a row; on a grid as fine as the noise, fewer are often equal
PARTS: Final = 4  # of the speeds between the edge and twice the edge: a wheel that passes them has readings in each
EVENLY: Final = 0.25  # least number of readings in a part, as a share of the mean: fewer mean a dwell next to zero


def _shown_width(channels: Channels) -> tuple[float, float]:
    return 2.0 * channels.speed_step_rad_s, 0.1 * float(channels.used_speed_rad_s.max())


class SpeedDeadZone(MeanEffect):
    """Friction that is missing in a narrow band of speeds around zero.

    Below a smallest speed the tachometer reads nothing. What that does depends on how the record came to be. Where
    friction is computed from the speed by a friction model, or estimated with the speed read, its part that follows the
    sign is lost inside the zone: this is the plateau of the formula. A torque balance K_T I − J dω/dt does not lose it:
    the current still carries the friction, and as the dω/dt of the reading is zero inside, J dω/dt of the true motion
    is added to it, with a pulse of the opposite sign where the reading jumps at the ends. There the zone shows in the
    speed readings, not as this plateau. `read_speed` gives what such a tachometer reads.

    What shows it
    -------------
    A plateau around zero speed with sharp ends, in friction that was computed with the speed read; a speed that reads
    exactly zero while the wheel reverses, in any record.

    See Also
    --------
    stribeck, presliding, sublinear_viscous

    References
    ----------
    Elementary: a tachometer that counts pulses has a smallest speed at which a pulse falls into its gate time. The
    width is a working assumption.
    """

    name = "speed_dead_zone"
    threshold = "dead_zone_rad_s"
    title = "Dead zone of the speed reading"
    formula = r"\tau = -\tau_0\, \operatorname{sign}(\omega) \text{ where } |\omega| < \omega_{dz}, \text{ else } 0"
    separate_by = "A slow zero crossing: a plateau has sharp ends, a Stribeck peak fades out and has the other sign."
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 1.6e-3, linear=True),
        Parameter("dead_zone_rad_s", "rad/s", 1e-4, 100.0, 1.0, shown=_shown_width),
    )

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        inside = np.abs(channels.speed_rad_s) < shape["dead_zone_rad_s"]
        # Where the speed is not known, neither is the column: direction is NaN there and so is the product.
        return np.where(inside | np.isnan(channels.speed_rad_s), -channels.direction, 0.0)

    def read_speed(self, speed_rad_s: FloatArray) -> FloatArray:
        """Return what a tachometer with this dead zone reads [rad/s]: zero inside."""
        return np.where(np.abs(speed_rad_s) < self.values["dead_zone_rad_s"], 0.0, speed_rad_s)


# ---- a dead zone in the readings: they stay at zero, or at the last one outside, while the wheel passes through ------


class ReadZone(NamedTuple):
    """A dead zone estimated from readings of the speed.

    Attributes
    ----------
    width_rad_s, std_rad_s
        The slowest reading of a moving wheel, and its standard deviation from the zone's edge [rad/s].
    inside
        bool (n,), readings that rest.
    deviance
        Twice the log-likelihood ratio of no readings within the zone, against readings as dense as next to it.
    """

    width_rad_s: float
    std_rad_s: float
    inside: BoolArray
    deviance: float


def read_zone(speed_rad_s: FloatArray, step_rad_s: float) -> ReadZone | None:
    """Return the dead zone in readings of the speed; None where there is none.

    A wheel that passes zero at constant acceleration is below a speed as long as between that and twice that speed.
    There is a zone where readings fill the latter range, rest between the crossings, and none is slower. A wheel that
    stops also has slower readings, one that crosses zero fast does not rest, and one that dwells next to zero does not
    fill the range around.

    Parameters
    ----------
    speed_rad_s
        float64 (n,), readings in order, NaN where unknown [rad/s].
    step_rad_s
        Step of their grid, 0 for none: between zero and one step there are no readings in any case.
    """
    known = np.flatnonzero(np.isfinite(speed_rad_s))
    reading = speed_rad_s[known]
    begins = np.diff(reading, prepend=np.nan) != 0.0
    run = np.cumsum(begins) - 1
    held = ~begins & (np.bincount(run)[run] >= FEWEST_HELD)
    rests = held | (reading == 0.0)
    moving = np.flatnonzero(~rests)
    size, side = np.abs(reading[moving]), np.sign(reading[moving])
    if moving.size < 2 or not rests.any():
        return None
    width, between = float(size.min()), np.diff(moving) - 1
    crossed = (side[1:] != side[:-1]) & (between > 0)
    # Count the readings next to the edge that belong to a passage: without a gap, up to twice the edge's speed.
    near = size < 2.0 * width
    passage = np.cumsum(np.append(True, ~(near[1:] & near[:-1])))
    passed = near & np.isin(passage, passage[1:][crossed & near[1:]])
    filled = np.bincount(((size[passed] / width - 1.0) * PARTS).astype(np.int64), minlength=PARTS)[:PARTS]
    count = 1.0 * min(int(filled.sum()), int(between[crossed].sum()))
    count *= max(width - step_rad_s, 0.0) / width
    if count < FEWEST_RESTS or filled.min() < EVENLY * filled.mean():
        return None
    # A wheel that crosses an existing zone fast leaves a reading that is held for a sample or two.
    side_of_run = np.sign(reading[begins])
    turns = np.append(side_of_run[1:] != side_of_run[:-1], False)[run]
    inside = np.zeros(speed_rad_s.size, dtype=np.bool_)
    inside[known[(rests & (np.abs(reading) < 2.0 * width)) | (~begins & turns)]] = True
    return ReadZone(width, max(width / (int(passed.sum()) + 1), step_rad_s), inside, float(2.0 * np.log(2.0) * count))


SMOOTHING_SLOTS: Final = (7, 15)  # of the parabola that estimates the true speed: for one that bends much, or little
LONGEST_STENCIL: Final = 8  # slots to each side: a Savitzky-Golay window of 2 s at 8 Hz
WIDER: Final = 8.0  # factor on the multiples used in each round: a step fitted to some numbers eight times as many
ON_LATTICE: Final = 1e-3  # of a step: how far a reading may be off its grid point (rounding of the file)
SHARE_OF_SCATTER: Final = 0.25  # least share of rounding in the readings' variance; below, noise dominates


class TachometerQuantisation(NoiseEffect):
    """Quantised speed readings; the friction derived from them carries the steps' derivative.

    A tachometer counts pulses, so that its speed comes in steps. Friction derived from it carries the derivative of the
    rounding errors, which is not white: with a central difference the autocorrelation at lag 2 is −0.5 and the variance
    of long means tends to zero.

    What shows it
    -------------
    Speeds on a grid, and a residual with an autocorrelation of −0.5 at lag 2.

    See Also
    --------
    coloured_noise

    References
    ----------
    B. Widrow, I. Kollár, Quantization Noise, Cambridge University Press 2008 (error uniform over a step); lag-2
    correlation: elementary, Cov(q_{k+1} − q_{k−1}, q_{k+3} − q_{k+1}) = −σ². Steps of 0.01 to 0.1 rad/s are a working
    assumption.
    """

    name = "tachometer_quantisation"
    follows_acceleration = True
    formula = (
        r"\omega_{\mathrm{read}} = \Delta \operatorname{round}(\omega/\Delta), \qquad n_k = -J\, \frac{q_{k+1} - "
        r"q_{k-1}}{2 \Delta t}, \quad q = \omega_{\mathrm{read}} - \omega"
    )
    separate_by = "A histogram of the speed readings; the autocorrelation of the residual at lag 2."
    parameters = (
        Parameter("step_rad_s", "rad/s", 1e-9, 10.0, 1.0e-2),
        Parameter("inertia_kg_m2", "kg m²", 0.0, np.inf, 0.0117, default=0.0117),
    )

    def apply(self, noise_Nm: FloatArray, channels: Channels, rng: np.random.Generator) -> FloatArray:
        """Add the friction's error from the rounding: -J times its central difference, one-sided at the ends."""
        error = self.read_speed(channels.speed_rad_s) - channels.speed_rad_s
        return noise_Nm - self.values["inertia_kg_m2"] * np.gradient(error, channels.sample_period_s)

    def read_speed(self, speed_rad_s: FloatArray) -> FloatArray:
        step = self.values["step_rad_s"]
        return step * np.rint(speed_rad_s / step)

    @classmethod
    def fitted(
        cls, residual_Nm: FloatArray, channels: Channels, usable: BoolArray, variance_inflation: float
    ) -> LikelihoodFit:
        """Find the grid of the speed readings; regress the residual on the derivative of the rounding errors."""
        speed, fits = channels.speed_rad_s, [cls.nothing_found(int(usable.sum()))]
        step = quantisation_step(speed[usable])
        if step is None or speed.size < 2 * max(SMOOTHING_SLOTS):
            return fits[0]
        from scipy import signal

        for slots in SMOOTHING_SLOTS:
            error = speed - signal.savgol_filter(speed, slots, 2, mode="constant", cval=np.nan)
            followed = signal.savgol_coeffs(slots, 2)[slots // 2]  # weight of a sample in its own fitted value
            # By the median, which outliers do not move.
            scatter = float(np.nanmedian(error**2)) / CHI_MEDIAN / (1.0 - followed)
            if step**2 / 12.0 >= SHARE_OF_SCATTER * scatter:
                fits += [
                    cls._regress(residual_Nm, error, usable, channels.sample_period_s, step, stencil)
                    for stencil in (1, min(LONGEST_STENCIL, slots // 2))
                ]
        if len(fits) == 1:
            return fits[0]
        best = max(fits, key=lambda fit: fit.penalised_gain)
        return replace(best, std={**best.std, "step_rad_s": error_of_step(speed[usable], step)})

    @classmethod
    def _regress(
        cls, residual: FloatArray, error: FloatArray, usable: BoolArray, period_s: float, step: float, stencil: int
    ) -> LikelihoodFit:
        """Regress on the central differences of the error over 1 … `stencil` slots; their coefficients add up to -J."""
        size = residual.size
        inner = slice(stencil, size - stencil)
        differences = [
            (error[stencil + j : size - stencil + j] - error[stencil - j : size - stencil - j]) / (2 * j * period_s)
            for j in range(1, stencil + 1)
        ]
        design = np.stack(differences, axis=1)
        rows = usable[inner] & np.isfinite(design).all(axis=1)
        count = int(rows.sum())
        target = residual[inner][rows]
        total = float(np.sum(target**2))
        if count <= 2 * stencil or total == 0.0:
            return cls.nothing_found(count)
        scale = np.sqrt(np.mean(design[rows] ** 2, axis=0))
        scale[scale == 0.0] = 1.0
        coefficients, *_ = np.linalg.lstsq(design[rows] / scale, target, rcond=None)
        residual_energy = float(np.sum((target - (design[rows] / scale) @ coefficients) ** 2))
        inertia = max(-float(np.sum(coefficients / scale)), 0.0)
        information = design[rows].T @ design[rows]
        variance = residual_energy / (count - stencil) * float(np.linalg.pinv(information).sum())
        return LikelihoodFit(
            values={"step_rad_s": step, "inertia_kg_m2": inertia},
            std={"step_rad_s": 0.0, "inertia_kg_m2": float(np.sqrt(max(variance, 0.0)))},
            # An exact fit would have an infinite likelihood: the residual is at least the rounding of floats.
            log_likelihood_gain=-0.5 * count * float(np.log(max(residual_energy / total, np.finfo(np.float64).eps))),
            parameters=stencil + 1,
            samples=count,
        )


def quantisation_step(speed_rad_s: FloatArray) -> float | None:
    """Return the step of the grid of speed readings [rad/s], or None where they lie on none.

    The step is the smallest difference of distinct readings, and every reading must be a multiple of it. A table
    written with seven digits is on a grid, too: whether a step matters is for the caller to decide.
    """
    levels = np.unique(speed_rad_s)
    if levels.size < 2:
        return None
    gaps = np.diff(levels)
    gaps[gaps <= gaps.max() * 1e-9] = np.inf  # multiples of a step differ in their last bits
    at, step = int(np.argmin(gaps)), float(gaps.min())
    # The smallest gap carries the rounding of two readings: the step is refined over more and more of its multiples.
    span, reach = levels - levels[at], 1.0
    while reach * step < np.abs(span).max():
        reach *= WIDER
        near = span[np.abs(span) <= reach * step]
        multiples = np.rint(near / step)
        step = float(np.sum(near * multiples) / np.sum(multiples**2))
    multiples = np.rint(levels / step)
    if not multiples.any():  # two readings, half a step to either side of rest
        return None
    step = float(np.sum(levels * multiples) / np.sum(multiples**2))
    off = np.abs(levels / step - np.rint(levels / step))
    return step if off.max() < ON_LATTICE else None


def error_of_step(speed_rad_s: FloatArray, step: float) -> float:
    """Return the standard deviation of the step of a grid from the distances of its readings to the grid [rad/s].

    The distance is taken as at least the spacing of floats.
    """
    levels = np.unique(speed_rad_s)
    multiples = np.rint(levels / step)
    off = max(float(np.sqrt(np.mean((levels - multiples * step) ** 2))), float(np.spacing(np.abs(levels).max())))
    return off / float(np.sqrt(np.sum(multiples**2)))
