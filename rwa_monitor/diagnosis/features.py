"""Features: what stage 3 hands to the classifiers, one set per window.

Dry and viscous friction are single coefficients; a switching system is the list of its sojourns. Where a system never
rests in the window (q = 0), its friction is known only up to an offset, which the base dry friction has with opposite
sign (errata 10); `rests` is then false, and the joint classifier integrates over the offset.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from rwa_monitor.changepoints.estimation import SlopePrior, nominal_viscous
from rwa_monitor.changepoints.stage_results import Assignment, Components
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.wheel.wheel import Wheel

LEAST_INFORMATION: Final = 1e-3  # share of the slope's information that must come from the window, or it measures none


class SystemFeatures(NamedTuple):
    """Sojourns of one switching system.

    Attributes
    ----------
    name
        The system's name.
    configuration
        int64 (sojourns,).
    friction, friction_std
        float64 (sojourns,), normalised by the nominal dry torque. Where the system never rests, `friction_std` is that
        of the differences, not of the common offset.
    rests
        Whether it visits q = 0, so that friction is absolute.
    """

    name: str
    configuration: IntArray
    friction: FloatArray
    friction_std: FloatArray
    rests: bool

    @property
    def unmoved(self) -> bool:
        """Whether the system made no jump in the window."""
        return self.configuration.size < 2

    def active(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return configuration, friction and std of the sojourns above q = 0."""
        above = self.configuration > 0
        return self.configuration[above], self.friction[above], self.friction_std[above]

    def highest(self) -> tuple[int, float, float]:
        """Return the highest configuration visited, the mean friction in it and its standard deviation."""
        q = int(self.configuration.max(initial=0))
        if q == 0:
            return 0, 0.0, 0.0
        there = self.configuration == q
        count = np.count_nonzero(there)
        std = math.sqrt(np.sum(np.square(self.friction_std[there])) / count / count)
        return q, float(np.sum(self.friction[there])) / count, std


class Features(NamedTuple):
    """All that the classifiers see of a window, each coefficient in units of its nominal value.

    Attributes
    ----------
    base_dry, base_dry_std
        Base dry friction, by the nominal dry torque.
    viscous, viscous_std
        Viscous friction, by the nominal viscous friction (where the wheel has one).
    systems
        One entry per switching system, in the wheel's order.
    by_path
        The same by all paths that the samples do not rule out, where there is more than one; with standard deviations
        of the measurement alone.
    viscous_unit
        The nominal viscous friction in the stages' units, dry torque over nominal speed; 1 where the wheel has none.
    log_weight
        Of one path: see `stage_results.ConditionalEstimate`.
    same_jumps
        Whether every jump is made by the system of the assignment, so that a path differs in configurations only.
    """

    base_dry: float
    base_dry_std: float
    viscous: float
    viscous_std: float
    systems: tuple[SystemFeatures, ...]
    by_path: tuple[Features, ...] = ()
    viscous_unit: float = 1.0
    log_weight: float = 0.0
    same_jumps: bool = True

    @property
    def base_known(self) -> bool:
        """Whether all systems rest at some time, so that the window itself identifies the base dry friction."""
        return all(system.rests for system in self.systems)

    def measured(self, anomaly: int) -> tuple[int, float, float]:
        """Return configuration, value and std by which an anomaly is judged, given its number in the wheel's order.

        For a system, the value is the mean friction of its highest configuration.
        """
        if anomaly == 0:
            return 0, self.base_dry, self.base_dry_std
        return (0, self.viscous, self.viscous_std) if anomaly == 1 else self.systems[anomaly - 2].highest()


def features_of(components: Components, assignment: Assignment, wheel: Wheel) -> Features:
    """Return the features of a window from the results of stage 3."""
    unit = nominal_viscous(wheel) or 1.0
    features = Features(
        base_dry=components.base_dry,
        base_dry_std=components.base_dry_std,
        viscous=components.viscous / unit,
        viscous_std=components.viscous_std / unit,
        systems=_systems(components, assignment.configurations, assignment, wheel),
        viscous_unit=unit,
    )
    by_path = tuple(
        features._replace(
            base_dry=one.components.base_dry,
            base_dry_std=one.components.base_dry_std,
            systems=_systems(one.components, one.path.split(one.path.configurations), assignment, wheel),
            log_weight=one.log_weight,
            same_jumps=all(map(np.array_equal, one.path.split(one.path.starts), assignment.starts)),
        )
        for one in components.by_path
    )
    return features._replace(by_path=by_path)


def without_prior(features: Features, prior: SlopePrior) -> Features:
    """Return the features with viscous friction as this window alone measures it.

    Stage 3 has the slope of earlier windows as its prior. Passed on as a measurement, that would count again in every
    window with little information on it. A Gaussian posterior over its Gaussian prior is the window's own likelihood.

    Parameters
    ----------
    features
        Of the window.
    prior
        Of the slope, as stage 3 used it.
    """
    mean, std = prior.mean / features.viscous_unit, prior.std / features.viscous_unit
    left = (features.viscous_std / std) ** 2
    own = 1.0 - left
    alone: dict[str, Any] = {"viscous": mean, "viscous_std": math.inf}
    if own > LEAST_INFORMATION:
        alone["viscous"] = (features.viscous - left * mean) / own
        alone["viscous_std"] = features.viscous_std / math.sqrt(own)
    return features._replace(**alone, by_path=tuple(one._replace(**alone) for one in features.by_path))


def _systems(
    parts: Components, configurations: tuple[IntArray, ...], assignment: Assignment, wheel: Wheel
) -> tuple[SystemFeatures, ...]:
    found = []
    for s, (system, configuration) in enumerate(zip(wheel.fss, configurations, strict=True)):
        rests = not configuration.all()
        # For a system that never rests, stage 3's std includes the offset common to all sojourns; that of their
        # differences comes from the jumps.
        std = parts.fss_friction_std[s]
        if not rests:
            own = assignment.jump_std[assignment.system == s]
            std = np.full(configuration.size, float(own.mean()) if own.size else 0.0)
        found.append(SystemFeatures(system.name, configuration, parts.fss_friction[s], std, rests))
    return tuple(found)
