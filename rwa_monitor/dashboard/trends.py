"""Where a wheel's estimates go, and when they will reach the next alarm limit, for the page."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rwa_monitor.diagnosis.trend import MAX_WINDOWS, MIN_WINDOWS
from rwa_monitor.history.alarms import Policy
from rwa_monitor.history.records import EstimateRecord
from rwa_monitor.messages import Message, Number
from rwa_monitor.monitor.trends import coefficient_trend
from rwa_monitor.samples import SECONDS_PER_DAY


class ReachRecord(Message):
    """When a limit will be reached: median and 95 % interval, in seconds after the last window; null for never."""

    limit: Number
    level: str
    median_s: Number | None
    low_s: Number | None
    high_s: Number | None


class TrendRecord(Message):
    """What the windows of a wheel show of the trend of one estimate (`diagnosis.trend`)."""

    name: str
    unit: str
    windows: int
    present: bool
    p_value: Number
    slope_per_day: Number
    slope_std_per_day: Number
    reach: ReachRecord | None


def trends(estimates: Sequence[EstimateRecord], policy: Policy) -> list[TrendRecord]:
    """Return the trends of the estimates that have a standard deviation, and windows enough for one.

    Parameters
    ----------
    estimates
        Of one wheel, the oldest first.
    policy
        Where the limits lie.
    """
    found = []
    for name in dict.fromkeys(one.name for one in estimates):
        own = [one for one in estimates if one.name == name and one.value is not None and one.std][-MAX_WINDOWS:]
        record = _trend(own, policy) if len(own) >= MIN_WINDOWS else None
        if record is not None:
            found.append(record)
    return found


def _trend(own: Sequence[EstimateRecord], policy: Policy) -> TrendRecord | None:
    coefficient = coefficient_trend(own[-1].name, own)
    if coefficient is None:
        return None
    trend, now_s = coefficient.trend, coefficient.trend.lines.now_s
    above = [(limit, level) for limit, level in _limits(own, policy) if limit > trend.value]
    reach = trend.reach(above[0][0]) if above else None
    return TrendRecord(
        name=own[-1].name,
        unit=own[-1].unit,
        windows=trend.windows,
        present=trend.present,
        p_value=trend.p_value,
        slope_per_day=trend.slope * SECONDS_PER_DAY,
        slope_std_per_day=trend.slope_std * SECONDS_PER_DAY,
        reach=None
        if reach is None
        else ReachRecord(
            limit=reach.limit,
            level=above[0][1],
            median_s=_after(reach.time_s, now_s),
            low_s=_after(reach.low_s, now_s),
            high_s=_after(reach.high_s, now_s),
        ),
    )


def _limits(own: Sequence[EstimateRecord], policy: Policy) -> list[tuple[float, str]]:
    """Return the values at which an estimate reaches a level, ascending.

    A severity s is the nominal bound plus s steps; how long a step is shows in a window with a severity above 0.
    """
    bound = own[-1].nominal_high
    if bound is None:
        return []
    limits = [(bound, "watch")]
    for one in reversed(own):
        if one.severity and one.value is not None and one.nominal_high == bound:
            step = (one.value - bound) / one.severity
            levels = ((policy.warning, "warning"), (policy.distress, "distress"), (policy.critical, "critical"))
            limits += [(bound + severity * step, level) for severity, level in levels]
            break
    return limits


def _after(time_s: float, now_s: float) -> float | None:
    return time_s - now_s if math.isfinite(time_s) else None
