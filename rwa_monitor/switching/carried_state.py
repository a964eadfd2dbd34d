"""The carried state: what earlier windows of a wheel pass on to the next one.

A window alone does not identify everything: where a switching system never rests (q = 0), only the sum of its friction
and the base dry friction is identifiable (errata 10). Earlier windows of the same wheel separate them. The estimates of
these windows are kept here, small, normalised as in `stage_results`, and written as JSON with 12 significant digits; a
diagnosis is a function of its window and this state, whose hash it names.

The carried state never moves a nominal range. Those come from the model alone, so a slowly growing anomaly cannot
become the new normal: the state only tracks what the wheel's friction *is*, normal or not.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Final, Literal

import numpy as np
from pydantic import Field

from rwa_monitor.changepoints.stage_results import Assignment, Components
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.wheel.file_content import Finite, Hashed, NotNegative, Probability, Strict, canonical_json
from rwa_monitor.wheel.wheel import Wheel

MAX_STATE_BYTES: Final = 200_000  # a state of 8 systems with 16 configurations takes some 20 kB

# Friction of a healthy wheel moves by a few per cent with temperature and age (lubricant: months; bearing temperature:
# an orbit). Step of the random walk from one window to the next, as a fraction of the value.
DRIFT_PER_WINDOW: Final = 0.01
# Probability of a permanent change of the wheel from one window to the next (one in fifty windows, six days of windows
# of 10,000 s; a working assumption): then it is as likely anomalous as any wheel, and a coefficient may be anywhere.
CHANGE_PER_WINDOW: Final = 0.02
# Wear does not heal: of the changes of an anomalous wheel, this share leaves it anomalous whatever else they do.
STILL_ANOMALOUS: Final = 0.98
# Forgetting factor per window of a configuration's friction, so that about the last 20 windows count.
REMEMBERED: Final = 0.95

Count = Annotated[int, Field(ge=0)]


class Tracked(Strict):
    """A value that is followed over windows by a scalar Kalman filter with a random walk.

    Attributes
    ----------
    mean, std
        Current value and its standard deviation, normalised.
    windows
        Number of windows that it was learned from.
    held
        Probability that the value has not changed since: it may have in a window that did not identify it.
    """

    mean: Finite
    std: NotNegative
    windows: Annotated[int, Field(ge=1)]
    held: Probability = 1.0

    def changed(self, **fields: float) -> Tracked:
        """Return the value with some fields changed."""
        return Tracked.model_validate({**dict(self), **fields})

    def drifted(self) -> Tracked:
        """Return the prediction for the next window, before that window is seen."""
        std = math.hypot(self.std, DRIFT_PER_WINDOW * abs(self.mean))
        return self.changed(std=std, held=(1.0 - CHANGE_PER_WINDOW) * self.held)

    def scaled(self, factor: float) -> Tracked:
        """Return the value in another unit: mean and std times `factor`."""
        return self.changed(mean=self.mean * factor, std=self.std * abs(factor))


class FrictionMemory(Strict):
    """Recent friction of a configuration, with exponential forgetting by `REMEMBERED` per window.

    Attributes
    ----------
    count
        Effective number of sojourns.
    mean, std
        Their mean and standard deviation (0 for a single one), normalised by the nominal dry torque.
    """

    count: NotNegative
    mean: Finite
    std: NotNegative


class SystemState(Strict):
    """State of one switching system after earlier windows.

    Attributes
    ----------
    name
        The system's name in the wheel file.
    configuration, age
        Configuration at the slot at which the next window begins, and the least number of slots that the system has
        been in it; None where not known.
    friction
        One memory for each configuration, None for those not seen.
    """

    name: str
    configuration: Count | None = None
    age: Count | None = None
    friction: tuple[FrictionMemory | None, ...] = ()


class CarriedState(Hashed):
    """What earlier windows of a wheel pass on to the next one; all values normalised.

    Attributes
    ----------
    version
        Version of this format.
    windows
        Number of windows diagnosed so far.
    base_dry, viscous
        Current friction coefficients, normal or not. Learned only from windows that identify them.
    noise_std
        Noise of the last window.
    probability
        For each anomaly the probability after the last window, from which the prior of the next one follows.
    inadequate
        Windows in a row in which the friction model did not fit.
    fss
        One entry per switching system.
    """

    what: ClassVar[str] = "carried state"
    limit: ClassVar[int] = MAX_STATE_BYTES

    version: Literal[1] = 1
    windows: Count = 0
    base_dry: Tracked | None = None
    viscous: Tracked | None = None
    noise_std: NotNegative | None = None
    probability: dict[str, Probability] = Field(default_factory=dict)
    inadequate: Count = 0
    fss: tuple[SystemState, ...] = ()

    @staticmethod
    def empty() -> CarriedState:
        """Return the state before any window: always the same object, so that it is hashed once."""
        return _EMPTY

    def system(self, name: str) -> SystemState | None:
        """Return the state of the switching system of that name, or None."""
        return next((system for system in self.fss if system.name == name), None)

    def to_json(self) -> str:
        """Write the state as canonical JSON."""
        return canonical_json(self.model_dump(mode="json"))


_EMPTY: Final = CarriedState()


def next_systems(
    carried: CarriedState, wheel: Wheel, assignment: Assignment, components: Components, *, learn: bool
) -> tuple[SystemState, ...]:
    """Return the state of each switching system after a window.

    Parameters
    ----------
    carried
        The state before it.
    wheel
        Its wheel.
    assignment, components
        Results of stage 3.
    learn
        Whether the window itself identifies the base dry friction; else the systems' friction is not learned from it.
    """
    hop, found = wheel.window.hop_slots, []
    sojourns = zip(wheel.fss, assignment.configurations, assignment.starts, components.fss_friction, strict=True)
    for system, configurations, starts, friction in sojourns:
        before = carried.system(system.name)
        remembered = before.friction if before and before.friction else (None,) * system.configurations
        learned = friction if learn else np.full(configurations.size, np.nan)
        memories = tuple(_remember(remembered[q], configurations, learned, q) for q in range(system.configurations))
        configuration = age = None
        if hop <= wheel.window.samples:
            # The next window begins `hop` slots after this one: where windows overlap, the state at that slot counts.
            current = int(np.searchsorted(starts, hop, side="right")) - 1
            configuration, age = int(configurations[current]), hop - int(starts[current])
            if current == 0 and before and before.age is not None and before.configuration == configuration:
                age += before.age
        found.append(SystemState(name=system.name, configuration=configuration, age=age, friction=memories))
    return tuple(found)


def rate_after_change(probability: float, rate: float) -> float:
    """Return the probability of an anomaly after a change, given that before it and its rate in the population."""
    return rate + STILL_ANOMALOUS * probability * (1.0 - rate)


def probability_before(probability: float, rate: float) -> float:
    """Return the prior probability of an anomaly in a window, given that after the last one and its rate.

    Time alone raises it to the rate at most: a hundred windows without information must not add up to an anomaly.
    """
    changed = probability + CHANGE_PER_WINDOW * (rate_after_change(probability, rate) - probability)
    return min(changed, max(probability, rate))


def follow(before: Tracked | None, value: float, std: float, *, known: bool) -> Tracked | None:
    """Update a tracked value without a learned model by a window's estimate; unless `known`, only its std grows."""
    drifted = None if before is None else before.drifted()
    if not (known and math.isfinite(value) and math.isfinite(std)):
        return drifted
    if drifted is None:
        return Tracked(mean=value, std=std, windows=1)
    total = drifted.std**2 + std**2
    gain = drifted.std**2 / total if total > 0 else 1.0
    return Tracked(
        mean=drifted.mean + gain * (value - drifted.mean),
        std=math.sqrt(max(1.0 - gain, 0.0)) * drifted.std,
        windows=drifted.windows + 1,
    )


def _remember(
    before: FrictionMemory | None, configuration: IntArray, friction: FloatArray, q: int
) -> FrictionMemory | None:
    """Discount the memory of configuration q and add its new sojourns, those whose friction is finite."""
    own = friction[np.isfinite(friction) & (configuration == q)]
    if before is None and own.size == 0:
        return None
    count, mean, std = (REMEMBERED * before.count, before.mean, before.std) if before else (0.0, 0.0, 0.0)
    total, squares = count * mean + float(np.sum(own)), count * (std**2 + mean**2) + float(np.sum(own * own))
    count += own.size
    mean = total / count
    return FrictionMemory(count=count, mean=mean, std=math.sqrt(max(squares / count - mean**2, 0.0)))
