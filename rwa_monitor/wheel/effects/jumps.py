"""Jumps of the dry friction beyond those of wheel.toml: of another shape, of an extra system, or at other times."""

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy import special

from rwa_monitor.errors import InputError
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.durations import Geometric, Weibull
from rwa_monitor.wheel.effects.base import Channels, LikelihoodFit, Parameter, Shape, curvature_std, most_likely, stack
from rwa_monitor.wheel.effects.noise_laws import BINS
from rwa_monitor.wheel.effects.switching_base import (
    TINY,
    JumpClock,
    Jumps,
    Sojourns,
    SwitchingEffect,
    SwitchingEvidence,
)
from rwa_monitor.wheel.switching_systems import simulate_system
from rwa_monitor.wheel.wheel import FrictionRange, SwitchingSystem

SHORTEST_SLOTS: Final = 20  # of a relaxation: a shorter one cannot be distinguished from outliers next to a jump
LONGEST_SHARE: Final = 0.1  # of the record, of a relaxation: a longer one is a drift


def _shown_time(channels: Channels) -> tuple[float, float]:
    return SHORTEST_SLOTS * channels.sample_period_s, LONGEST_SHARE * channels.duration_s


class DecayingJump(SwitchingEffect):
    """After each jump a part of it fades away, until the next jump.

    A pocket of oil that is run over is squeezed out again: the drag jumps and then relaxes by a share of the jump. What
    has relaxed is forgotten at the next jump, so that the level always lies between its two neighbours.

    What shows it
    -------------
    An exponential in the residual after each jump, in proportion to the jump, of one time constant.

    See Also
    --------
    extra_switching_system, lubricant_lag

    References
    ----------
    Pockets of oil in wheel bearings: the paper, section III, and its reference of 2015, taken to be A. Y. Lee, E. K.
    Wang, In-flight performance of Cassini reaction wheel bearing drag in 1997–2013, Journal of Spacecraft and Rockets
    52(2), 2015. That their drag relaxes exponentially is a working assumption.
    """

    name = "decaying_jump"
    title = "Jumps that relax"
    formula = (
        r"\tau = -\gamma \sum_j \Delta_j \left(1 - e^{-(t - t_j)/T}\right) \operatorname{sign}(\omega), \quad t_j "
        r"\leq t < t_{j+1}"
    )
    separate_by = "Constant speed: a lag of the lubricant rests then, jumps still relax."
    not_exported = ""
    parameters = (
        Parameter("strength", "-", 0.0, 1.0, 0.5, linear=True),
        Parameter("time_constant_s", "s", 1e-3, 1e5, 60.0, shown=_shown_time),
    )

    @classmethod
    def columns(cls, channels: Channels, jumps: Jumps, shape: Shape) -> FloatArray:
        slots = len(channels)
        since_s = jumps.since_s(slots, channels.sample_period_s)
        return stack(channels.direction * jumps.last(slots) * np.expm1(-since_s / shape["time_constant_s"]))


class ViscousJump(SwitchingEffect):
    """Jumps whose size grows with the speed.

    Where lubricant moves in or out of the contact, the viscous coefficient jumps along with the dry friction: the jump
    is larger at high speed by the factor 1 + c|ω|.

    What shows it
    -------------
    Another slope after each jump; sizes of the same jump grow with |ω|.

    See Also
    --------
    speed_triggered_jumps, sublinear_viscous

    References
    ----------
    The paper keeps the viscous coefficient constant between jumps (section III-A); that a change of the lubricant
    distribution changes it is a working assumption without a verified size.
    """

    name = "viscous_jump"
    title = "Jumps of the viscous friction"
    formula = r"\tau = c\, \omega \sum_{t_j \leq t} \Delta_j"
    separate_by = "Change the speed between two jumps: the slope of each segment shows by itself."
    not_exported = ""
    parameters = (Parameter("strength_s_rad", "s/rad", -1.0, 1.0, 3.0e-3, linear=True),)

    @classmethod
    def columns(cls, channels: Channels, jumps: Jumps, shape: Shape) -> FloatArray:
        return stack(jumps.total(len(channels)) * channels.speed_rad_s)


class ExtraSwitchingSystem(SwitchingEffect):
    """A system of two configurations, at rest and active, with memoryless durations.

    A phenomenon that wheel.toml does not list switches between rest and extra friction, such as a cage that sits in two
    positions.

    What shows it
    -------------
    Jumps, with their way back, that no known switching system explains.

    See Also
    --------
    wrong_duration_law, cage_instability, decaying_jump

    References
    ----------
    The paper's friction switching systems (section III-B), one more of them; sizes are a working assumption.
    """

    name = "extra_switching_system"
    title = "A switching system that the model lacks"
    formula = r"\tau = f(t) \operatorname{sign}(\omega), \qquad f \in \{0,\; m\,(1 \pm 0.25)\}"
    separate_by = "A longer record: the sizes and durations of the unexplained jumps form groups of their own."
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 4.0e-4),
        Parameter("rest_s", "s", 1e-3, 1e7, 600.0),
        Parameter("active_s", "s", 1e-3, 1e7, 200.0),
    )

    def extra_level(self, channels: Channels, rng: np.random.Generator) -> FloatArray:
        slots = [max(1.0, self.values[name] / channels.sample_period_s) for name in ("rest_s", "active_s")]
        system = SwitchingSystem(
            name="extra",
            durations=tuple(Geometric(mean_slots=mean) for mean in slots),
            friction=(FrictionRange(low=0.0, high=0.0), FrictionRange(low=0.75, high=1.25)),
        )
        return self.values["strength_Nm"] * simulate_system(system, len(channels), rng).friction


FEWEST_SOJOURNS: Final = 5  # or jumps: fewer do not determine a law
MOST_TREND: Final = 0.5  # share of a covariate's variance that is a straight line over time: one rate is as the other
STEEPEST: Final = 20.0  # change of the log rate over the covariate's range: beyond, all jumps are at one value


class SpeedTriggeredJumps(SwitchingEffect):
    """A rate of jumps that follows speed or temperature, its mean over the record unchanged.

    Centrifugal force and heat move the lubricant: the switching systems run on a clock that goes faster at high speed
    or temperature. Over a record the clock's mean rate is one.

    What shows it
    -------------
    Jumps gather at certain speeds or temperatures instead of following time alone.

    See Also
    --------
    wrong_duration_law, viscous_jump

    References
    ----------
    D. R. Cox, P. A. W. Lewis, The Statistical Analysis of Series of Events, 1966 (log-linear rate). That jumps of
    wheels follow speed is a working assumption.
    """

    name = "speed_triggered_jumps"
    title = "Jumps triggered by speed or temperature"
    formula = r"\lambda(t) \propto e^{c |\omega| + k T}"
    separate_by = "Long dwells at two speeds: count the jumps in each."
    parameters = (
        Parameter("strength_s_rad", "s/rad", -1.0, 1.0, 1.0e-2, default=0.0),
        Parameter("strength_1_K", "1/K", -5.0, 5.0, 0.0, default=0.0),
    )

    def clock(self, channels: Channels) -> JumpClock:
        rate = self.values["strength_s_rad"] * np.abs(channels.speed_rad_s)
        if self.values["strength_1_K"] != 0.0:
            if channels.bearing_temperature_degC is None:
                raise InputError(f"effect {self.name}", "needs the bearing temperature", "strength_1_K")
            rate = rate + self.values["strength_1_K"] * channels.bearing_temperature_degC
        rate = np.exp(rate - rate.max())
        return JumpClock.from_rate(rate / rate.mean())

    @classmethod
    def fit(cls, evidence: SwitchingEvidence) -> LikelihoodFit:
        """Fit a log-linear rate in speed, and one in temperature where it was measured; return the better one."""
        channels = evidence.channels
        fits = [cls._fit_one(evidence, np.abs(channels.speed_rad_s), "strength_s_rad")]
        if channels.bearing_temperature_degC is not None:
            fits.append(cls._fit_one(evidence, channels.bearing_temperature_degC, "strength_1_K"))
        return max(fits, key=lambda fit: fit.log_likelihood_gain)

    @classmethod
    def _fit_one(cls, evidence: SwitchingEvidence, covariate: FloatArray, name: str) -> LikelihoodFit:
        """Fit λ ∝ exp(c·x) to the sojourns where jumps were attributed, else to the positions of all jumps."""
        known = evidence.good & np.isfinite(covariate)
        everywhere = covariate[known]
        nothing = cls.nothing_found(len(evidence.jumps))
        if len(evidence.jumps) < FEWEST_SOJOURNS or everywhere.size < 2 or np.ptp(everywhere) == 0.0:
            return nothing
        low, span = float(everywhere.min()), float(np.ptp(everywhere))
        if np.corrcoef(everywhere, np.flatnonzero(known))[0, 1] ** 2 > MOST_TREND:
            return nothing  # cannot be distinguished from a rate that changes with time
        # From 0 to 1 over its range; where it is not known, the mean is taken.
        x = np.where(known, (covariate - low) / span, float((everywhere.mean() - low) / span))
        gain = _sojourn_gain(evidence, x) if evidence.sojourns else _place_gain(evidence, x)

        c, step = 0.0, STEEPEST
        for points in (4 * int(STEEPEST) + 1, 41):
            grid = np.linspace(c - step, c + step, points)
            c, step = max(grid.tolist(), key=gain), float(grid[1] - grid[0])
        (bounds,) = [(p.low, p.high) for p in cls.parameters if p.name == name]
        return LikelihoodFit(
            {**cls().values, name: float(np.clip(c / span, *bounds))},
            nothing.std | {name: curvature_std(_place_gain(evidence, x), c, 0.05) / span},
            max(gain(c), 0.0),
            1,
            len(evidence.jumps),
        )


def _place_gain(evidence: SwitchingEvidence, x: FloatArray) -> Callable[[float], float]:
    """Return the gain of c by the positions of the jumps alone: Σ_j c·x_j - m·log mean exp(c·x), a Poisson process."""
    # The value just before a jump triggers it. The mean over slots is computed over narrow bins.
    at_jumps = x[np.maximum(evidence.jumps.index - 1, 0)]
    count, edges = np.histogram(x, bins=BINS, range=(0.0, 1.0))
    middle = 0.5 * (edges[1:] + edges[:-1])

    def gain(c: float) -> float:
        rate = np.exp(c * middle - abs(c))
        return c * float(at_jumps.sum()) - at_jumps.size * (abs(c) + float(np.log(np.sum(count * rate) / x.size)))

    return gain


def _sojourn_gain(evidence: SwitchingEvidence, x: FloatArray) -> Callable[[float], float]:
    """Return the gain of c by the sojourns, which follow the known laws on a clock of rate ∝ exp(c·x)."""

    def log_likelihood(c: float) -> float:
        """Return the log-likelihood of all sojourns on the clock of this c."""
        rate = np.exp(c * x - abs(c))
        rate /= rate.mean()
        elapsed = np.concatenate([[0.0], np.cumsum(rate)])
        total = 0.0
        for name, sojourns in evidence.sojourns.items():
            if name in evidence.systems:
                end = sojourns.start + sojourns.slots
                length = np.maximum(np.rint(elapsed[end] - elapsed[sojourns.start]), 1.0).astype(np.int64)
                total += sojourns.log_likelihood(evidence.systems[name], length)
                total += float(np.sum(np.log(rate[end - 1])))
        return total

    plain = log_likelihood(0.0)
    return lambda c: log_likelihood(c) - plain


class WrongDurationLaw(SwitchingEffect):
    """Sojourns that follow a Weibull law with another mean than the known law's.

    The sojourns of a switching system are longer or shorter by a factor r than the mean μ of their known law, and
    spread otherwise (Weibull shape k; 1 is memoryless, large k is regular).

    What shows it
    -------------
    Durations between attributed jumps that do not follow the law in wheel.toml; jumps that look odd in time.

    See Also
    --------
    extra_switching_system, speed_triggered_jumps

    References
    ----------
    The paper's duration laws (section III-B); W. Weibull, A statistical distribution function of wide applicability, J.
    Applied Mechanics 18, 1951. Factors are a working assumption.
    """

    name = "wrong_duration_law"
    title = "Durations that do not follow their law"
    formula = r"P(d > t) = e^{-(t / \lambda)^k}, \qquad \lambda = \frac{r\, \mu_q}{\Gamma(1 + 1/k)}"
    separate_by = "A longer record, at constant speed and temperature."
    parameters = (
        Parameter("duration_factor", "-", 0.01, 100.0, 0.4),
        Parameter("weibull_shape", "-", 0.3, 20.0, 1.0),
    )

    def change_system(self, system: SwitchingSystem) -> SwitchingSystem:
        factor, shape = self.values["duration_factor"], self.values["weibull_shape"]
        laws = tuple(weibull_of_mean(factor * law.mean(), shape) for law in system.durations)
        return system.model_copy(update={"durations": laws})

    @classmethod
    def fit(cls, system: SwitchingSystem, sojourns: Sojourns) -> LikelihoodFit:
        """Fit factor and shape to the sojourns of one system, against its known laws."""
        means = np.array([law.mean() for law in system.durations])
        known = sojourns.log_likelihood(system, sojourns.slots)
        bounds = [(float(np.log(p.low)), float(np.log(p.high))) for p in cls.parameters]

        def gain(x: FloatArray) -> float:
            factor, shape = np.exp(x).tolist()
            total = 0.0
            for q, mean in enumerate(means):
                at = sojourns.slots[sojourns.configuration == q]
                total += float(np.sum(np.log(weibull_of_mean(factor * mean, shape).pmf(at) + TINY)))
            return total - known

        relative = sojourns.slots / means[sojourns.configuration]
        start = np.array([np.log(np.clip(relative.mean(), 0.011, 99.0)), 0.0])
        best, std, most = most_likely(gain, [start], bounds)
        names, values = [parameter.name for parameter in cls.parameters], np.exp(best)
        found, errors = (dict(zip(names, each.tolist(), strict=True)) for each in (values, values * std))
        return LikelihoodFit(found, errors, most, 2, int(sojourns.slots.size))


def weibull_of_mean(mean_slots: float, shape: float) -> Weibull:
    """Return the Weibull law of a given mean (before rounding to slots) and shape."""
    return Weibull(shape=shape, scale=mean_slots / float(special.gamma(1.0 + 1.0 / shape)))
