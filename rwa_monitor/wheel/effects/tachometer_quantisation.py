"""Tachometer quantisation: the speed comes in steps, and its derivative makes noise of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.wheel.effects.base import Channels, LikelihoodFit, NoiseEffect, Parameter

SMOOTHING_SLOTS: Final = (7, 15)  # of a parabola that stands for the true speed under the steps: as that bends, or not
LONGEST_STENCIL: Final = 8  # slots to each side: a Savitzky-Golay window of 2 s at 8 Hz
MEDIAN_OF_CHI_SQUARE: Final = 0.455  # with one degree of freedom, over its mean: a variance that outliers do not move
WIDER: Final = 8.0  # times as many multiples in each turn: a step known over some gives eight times as many rightly
ON_LATTICE: Final = 1e-3  # of a step: how far a reading may be off its grid point (rounding of the file)
SHARE_OF_SCATTER: Final = 0.25  # of the scatter of the readings: less, and it is noise, not rounding, that matters


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
    title = "Tachometer quantisation"
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
        """Add what a central difference of the read speed makes of the steps, at its ends one-sided."""
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
            followed = signal.savgol_coeffs(slots, 2)[slots // 2]  # of an error of its own, by the parabola
            scatter = float(np.nanmedian(error**2)) / MEDIAN_OF_CHI_SQUARE / (1.0 - followed)
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
        left = float(np.sum((target - (design[rows] / scale) @ coefficients) ** 2))
        inertia = max(-float(np.sum(coefficients / scale)), 0.0)
        information = design[rows].T @ design[rows]
        variance = left / (count - stencil) * float(np.linalg.pinv(information).sum())
        return LikelihoodFit(
            values={"step_rad_s": step, "inertia_kg_m2": inertia},
            std={"step_rad_s": 0.0, "inertia_kg_m2": float(np.sqrt(max(variance, 0.0)))},
            # A fit that leaves nothing at all would have an infinite likelihood: rounding is the least noise there is.
            log_likelihood_gain=-0.5 * count * float(np.log(max(left / total, np.finfo(np.float64).eps))),
            parameters=stencil + 1,
            samples=count,
        )


def quantisation_step(speed_rad_s: FloatArray) -> float | None:
    """Return the step of the grid that speed readings lie on [rad/s], or None where there is none.

    The step is the smallest difference of distinct readings, and every reading must be a multiple of it. A table
    written with seven digits is on a grid too: whether a step is of any consequence is for the caller to see.
    """
    levels = np.unique(speed_rad_s)
    if levels.size < 2:
        return None
    gaps = np.diff(levels)
    gaps[gaps <= gaps.max() * 1e-9] = np.inf  # multiples of a step differ in their last bits
    at, step = int(np.argmin(gaps)), float(gaps.min())
    # The smallest gap alone carries the rounding of two readings: it is refined over more and more multiples of it.
    span, reach = levels - levels[at], 1.0
    while reach * step < np.abs(span).max():
        reach *= WIDER
        near = span[np.abs(span) <= reach * step]
        multiples = np.rint(near / step)
        step = float(np.sum(near * multiples) / np.sum(multiples**2))
    multiples = np.rint(levels / step)
    step = float(np.sum(levels * multiples) / np.sum(multiples**2))
    off = np.abs(levels / step - np.rint(levels / step))
    return step if off.max() < ON_LATTICE else None


def error_of_step(speed_rad_s: FloatArray, step: float) -> float:
    """Return the standard deviation of the step of a grid from what its readings are off it [rad/s].

    Numbers that are off by nothing are still rounded to their own last bit.
    """
    levels = np.unique(speed_rad_s)
    multiples = np.rint(levels / step)
    off = max(float(np.sqrt(np.mean((levels - multiples * step) ** 2))), float(np.spacing(np.abs(levels).max())))
    return off / float(np.sqrt(np.sum(multiples**2)))
