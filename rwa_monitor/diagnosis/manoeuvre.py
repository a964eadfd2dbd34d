"""The shortest change of speed that decides whether dry or viscous friction is nominal, on this wheel.

At one speed only the sum of the two is identifiable. Two speeds that differ by Δ, held for n samples each before and
after a change, give the slope with the variance 2σ²/(n·Δ²), whatever the level is. Friction jumps from time to time:
each change of the speed within an interval between jumps adds as much information.
"""

import math
from dataclasses import dataclass
from typing import Final, Literal

from scipy import stats

from rwa_monitor.diagnosis.model import Model, models_for
from rwa_monitor.errors import InputError
from rwa_monitor.kernels.running_sums import BLOCK
from rwa_monitor.samples import SECONDS_PER_DAY
from rwa_monitor.wheel.switching_systems import jump_rate
from rwa_monitor.wheel.wheel import Wheel

CHANGES: Final = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # of the nominal speed


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """Changes of speed, there and back, that decide.

    Attributes
    ----------
    change_rad_s
        By how much the speed is changed.
    hold_s
        How long each of the two speeds is held before and after a change [s].
    changes
        How many changes of speed.
    duration_s
        Of all that, ramps included [s].
    """

    change_rad_s: float
    hold_s: float
    changes: int
    duration_s: float


def deciding_manoeuvres(
    wheel: Wheel, model: Model, name: Literal["dry", "viscous"], certainty: float, speed_rad_s: float | None = None
) -> list[Manoeuvre]:
    """Return the manoeuvres that decide, the shortest for each size of the change of speed, small ones first.

    Parameters
    ----------
    wheel, model
        The wheel, with its noise, and the model of its anomalies.
    name
        Which friction may be anomalous.
    certainty
        Wanted probability that a value at the edge of the nominal band, or at the median of the anomaly, is classified
        correctly.
    speed_rad_s
        Where the wheel runs; None: at its nominal speed. Where it cannot run faster, it is slowed down.

    Raises
    ------
    InputError
        If the wheel file lacks nominal friction or noise, or the speed is beyond its limit.
    """
    source, nominal, noise_Nm = f"wheel {wheel.name}", wheel.nominal, wheel.noise.friction_std_Nm
    if nominal is None or noise_Nm is None:
        raise InputError(
            source, "is missing: rwa-monitor identify learns it", "nominal" if nominal is None else "noise"
        )
    speed, top = abs(speed_rad_s or nominal.nominal_speed_rad_s), wheel.limits.max_speed_rad_s or math.inf
    if speed > top:
        raise InputError(source, f"is {top:.6g}, the speed is {speed:.6g}", "limits.max_speed_rad_s")
    learned = models_for(wheel, model)[wheel.anomalies.index(name)]
    if learned is None or learned.levels[0] is None:
        raise InputError(source, "has no nominal range of it", name)
    # At this std a threshold midway between nominal and anomalous has this probability of being right.
    between = learned.levels[0].severity_unit or learned.levels[0].reach
    wanted = 0.5 * between / float(stats.norm.ppf(certainty))
    # Of the slope [N m s/rad]: dry friction is the level at this speed, well known, less the slope times the speed.
    std = wanted * (nominal.viscous_Nm_s_rad if name == "viscous" else nominal.dry_torque_Nm / speed)
    found = [_of_change(wheel, share * nominal.nominal_speed_rad_s, noise_Nm, std) for share in CHANGES]
    # Manoeuvres longer than a day are not practical.
    return [one for one in found if one.duration_s < SECONDS_PER_DAY and one.change_rad_s <= max(top - speed, speed)]


def _of_change(wheel: Wheel, change_rad_s: float, noise_Nm: float, slope_std: float) -> Manoeuvre:
    """Return how often, and how long each time, speeds so far apart must be held [s]."""
    period_s, torque = wheel.sample_period_s, wheel.max_motor_torque_Nm
    ramp_s = 0.0
    if torque is not None and wheel.inertia_kg_m2 is not None:
        ramp_s = wheel.inertia_kg_m2 * change_rad_s / torque
    samples = 2.0 * (noise_Nm / (change_rad_s * slope_std)) ** 2  # to each side, if one change is to decide
    rate = sum(map(jump_rate, wheel.fss))  # jumps a sample
    longest = 0.25 / rate if rate > 0.0 else math.inf  # to each side: both take half of a mean interval between jumps
    changes = max(math.ceil(samples / longest), 1) if math.isfinite(longest) else 1
    hold_s = max(math.ceil(samples / changes), BLOCK) * period_s  # the monitor adds samples up in blocks
    return Manoeuvre(change_rad_s, hold_s, changes, changes * (2.0 * hold_s + ramp_s))
