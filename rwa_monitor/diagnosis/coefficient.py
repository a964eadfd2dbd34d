"""What earlier windows of a wheel showed of a friction coefficient, and what a window changes in it.

A healthy wheel's coefficient lies where it lies in its band, window after window, so a second measurement of the same
value is no second piece of evidence: what is carried is the value x, and whether it is anomalous is judged from x anew
in each window. Before a window, x is a mixture (a hidden Markov model with renewal: Rabiner 1989; the same mixture as
in Bayesian online changepoint detection, Adams and MacKay 2007, cut down to two run lengths, long and none):

* *held*: nothing changed, and x follows a random walk from what earlier windows measured, N(m, d²);
* *changed*: since the last window that showed it, x changed (`CHANGE_PER_WINDOW`) and is as likely anomalous as any
  (more likely if it was: `rate_after_change`).

With π the rate of the anomaly, p_c the density of healthy (c = 0) and anomalous (c = 1) values, a window that measures
z ± s, and m' ± s' the value with this measurement filtered in,

    p(c, z | held) = N(z; m, d² + s²) π_c p_c(m'; s') / Σ π p(m; d),        p(c, z | changed) = π'_c p_c(z; s),

where p_c(v; s) is the density of measuring v ± s and π' the rate after a change. A window that measures x well judges
by its own value, whatever went before; one that does not show x leaves it where it was, with the hazard that it changed
unseen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from rwa_monitor.diagnosis.model import AnomalyModel, Levels, log_densities
from rwa_monitor.samples import FloatArray
from rwa_monitor.switching.carried_state import Tracked, rate_after_change

# A value shows nothing when its standard deviation exceeds this share of the distance between nominal and anomalous.
INFORMATIVE_STD: Final = 0.4
# A window shows a coefficient by itself when the middle between the two is two standard deviations away from either.
SHOWING_STD: Final = 0.25
# From this probability that a value is still the one measured earlier, a window that does not show it leans on it: it
# was seen within the last ten windows.
LEANING_HELD: Final = 0.8
SMALLEST_PROBABILITY: Final = 1e-12
SMALLEST_STD: Final = 1e-9  # normalised: keeps densities finite where there is no noise


@dataclass(frozen=True, slots=True)
class Coefficient:
    """A coefficient before a window, in the features' unit.

    Attributes
    ----------
    levels, rate
        What was learned of it, and how often the anomaly occurs.
    before
        What earlier windows showed, drifted to this window; None where they showed nothing.
    """

    levels: Levels
    rate: float
    before: Tracked | None

    @property
    def prior(self) -> float:
        """The probability of the anomaly before the window."""
        if self.before is None:
            return self.rate
        return self.before.held * self._anomalous_before() + (1.0 - self.before.held) * self._rate_after_change()

    def log_evidence(self, value: FloatArray, std: FloatArray) -> FloatArray:
        """Return the log density of measuring `value` ± `std`, (n,) each, if nominal (row 0) or anomalous (row 1)."""
        if self.before is None:
            return log_densities(self.levels, value, std)
        prior = min(max(self.prior, SMALLEST_PROBABILITY), 1.0 - SMALLEST_PROBABILITY)
        return np.asarray(np.logaddexp(*self.log_parts(value, std)) - np.log(np.array([[1.0 - prior], [prior]])))

    def log_parts(self, value: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the log of p(class, value, held) and of p(class, value, changed), float64 (2, n) each."""
        changed = self._log_joint(value, std, self._rate_after_change())
        if self.before is None:
            return np.full_like(changed, -np.inf), changed
        mean, narrowed, log_predicted = _filtered(self.before, value, std)
        held = log_predicted + self._log_joint(mean, narrowed, self.rate)
        held -= np.logaddexp(*self._log_joint(np.array([self.before.mean]), np.array([self.before.std]), self.rate))
        with np.errstate(divide="ignore"):
            return held + np.log(self.before.held), changed + np.log1p(-self.before.held)

    def _log_joint(self, value: FloatArray, std: FloatArray, rate: float) -> FloatArray:
        return np.asarray(log_densities(self.levels, value, std) + np.log(np.array([[1.0 - rate], [rate]])))

    def _anomalous_before(self) -> float:
        """Return the probability that the value of earlier windows is anomalous; the rate without any."""
        if self.before is None:
            return self.rate
        joint = self._log_joint(np.array([self.before.mean]), np.array([self.before.std]), self.rate)[:, 0]
        return float(np.exp(joint[1] - np.logaddexp(joint[0], joint[1])))

    def _rate_after_change(self) -> float:
        return self.rate if self.before is None else rate_after_change(self._anomalous_before(), self.rate)

    def informative(self, std: float) -> bool:
        """Return whether a measurement this good distinguishes nominal from anomalous at all."""
        return std < INFORMATIVE_STD * self.levels.reach

    def leans(self, std: float) -> bool:
        """Return whether a window that measured the coefficient with `std` leans on earlier, better ones."""
        before = self.before
        return (
            before is not None
            and before.held > LEANING_HELD
            and before.std < min(std, INFORMATIVE_STD * self.levels.reach)
            and not std < SHOWING_STD * self.levels.reach
        )

    def after(self, value: float, std: float) -> Tracked | None:
        """Return what is known of the coefficient after a window that measured `value` ± `std`; None if still nothing.

        Where the window shows it, that it changed or not is one more uncertainty of the value, and the mixture becomes
        the Gaussian of the same mean and variance; otherwise the earlier value stays, with the probability that it is
        still that.
        """
        if not (math.isfinite(value) and math.isfinite(std)):
            return self.before
        measured = Tracked(mean=value, std=std, windows=1)
        if self.before is None:
            return measured if self.informative(std) else None
        at, spread = np.array([value]), np.array([std])
        held, changed = (float(np.logaddexp(*part[:, 0])) for part in self.log_parts(at, spread))
        share = math.exp(held - np.logaddexp(held, changed))
        mean, narrowed, _ = _filtered(self.before, at, spread)
        if not self.informative(std):
            return Tracked(mean=float(mean[0]), std=float(narrowed[0]), windows=self.before.windows + 1, held=share)
        both = share * float(mean[0]) + (1.0 - share) * value
        variance = share * (float(narrowed[0]) ** 2 + (float(mean[0]) - both) ** 2)
        variance += (1.0 - share) * (std**2 + (value - both) ** 2)
        return Tracked(mean=both, std=math.sqrt(variance), windows=self.before.windows + 1)


def coefficient(model: AnomalyModel | None, tracked: Tracked | None, unit: float = 1.0) -> Coefficient | None:
    """Return a coefficient before a window; None where nothing was learned about it.

    Parameters
    ----------
    model
        What was learned.
    tracked
        What earlier windows showed, None if nothing.
    unit
        What the features' unit is in that of `tracked`.
    """
    if model is None or model.levels[0] is None:
        return None
    return Coefficient(model.levels[0], model.rate, None if tracked is None else tracked.drifted().scaled(1.0 / unit))


def _filtered(before: Tracked, value: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean and std of the value held with a measurement filtered in, and the log density of measuring that."""
    total = np.maximum(np.hypot(before.std, std), SMALLEST_STD)
    mean = before.mean + (before.std / total) ** 2 * (value - before.mean)
    log_density = -0.5 * ((value - before.mean) / total) ** 2 - np.log(total * math.sqrt(2.0 * math.pi))
    return mean, before.std * std / total, log_density
