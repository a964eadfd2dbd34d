"""The records of the history, as the API shows them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal, NamedTuple

from pydantic import BeforeValidator

from rwa_monitor.diagnosis.trend import Reach
from rwa_monitor.history.alarms import BOUNDS, EventKind, Level
from rwa_monitor.messages import AlarmLevel, AlarmPhase, Message, Number, Share
from rwa_monitor.reporting.trends import FrictionEstimate, coefficient_trend
from rwa_monitor.samples import SECONDS_PER_DAY

# A level as a word, also from the number that the database has.
LevelWord = Annotated[AlarmLevel, BeforeValidator(lambda level: Level(level).word if isinstance(level, int) else level)]


class AlarmLine(Message):
    """One line of an alarm's audit trail; `person` is "" where no person did it."""

    event: EventKind
    level: LevelWord
    time_ns: int
    wall_ns: int
    person: str
    note: str


class AlarmRecord(Message):
    """One alarm from its rise to its end; `closed_ns` is null while it is open, `advice` what to do about it.

    Until `shelved_until_wall_ns`, on this machine's clock, it is shelved.
    """

    id: int
    spacecraft: str
    wheel: str
    name: str
    phase: AlarmPhase
    level: LevelWord
    peak: LevelWord
    reason: str
    advice: str
    raised_ns: int
    changed_ns: int
    closed_ns: int | None
    shelved_until_wall_ns: int | None
    trail: list[AlarmLine]


class MonitorState(NamedTuple):
    """Whether the monitor of a wheel reports.

    Attributes
    ----------
    spacecraft, wheel
        The wheel's.
    silent
        True where it has not reported for too long.
    time_ns
        The latest time known of the wheel [ns, the wheel's clock]; None where none is.
    reason
        In one sentence, since when; "" where it reports.
    """

    spacecraft: str
    wheel: str
    silent: bool
    time_ns: int | None = None
    reason: str = ""


class RetirementEvent(Message):
    """One audit event on the list of wheels: retired by a person, brought back by one, or back with its telemetry.

    `time_ns` is the end of the latest window that was known when it was retired, `wall_ns` the time of the event, on
    this machine's clock.
    """

    spacecraft: str
    wheel: str
    event: Literal["retired", "brought_back", "telemetry_arrived"]
    time_ns: int | None
    wall_ns: int
    person: str
    note: str

    @property
    def retired(self) -> bool:
        """Whether the wheel is retired after this."""
        return self.event == "retired"


class EstimateRecord(FrictionEstimate):
    """One estimate of one window, with its nominal range and what was diagnosed of it."""

    name: str
    probability: Share
    severity: Number | None
    active: bool


# ---- trends ----------------------------------------------------------------------------------------------------------


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


def trends(estimates: Sequence[EstimateRecord]) -> list[TrendRecord]:
    """Return where estimates go that have a standard deviation, and when they will reach the next alarm level.

    Parameters
    ----------
    estimates
        Of one wheel, the oldest first.
    """
    found = []
    for name in dict.fromkeys(one.name for one in estimates):
        own = [one for one in estimates if one.name == name and one.value is not None and one.std]
        if (coefficient := coefficient_trend(name, own)) is None:
            continue
        trend = coefficient.trend
        limit, level = next((one for one in _limits(own) if one[0] > trend.value), (None, ""))
        reach = None if limit is None else trend.reach(limit)
        found.append(
            TrendRecord(
                name=name,
                unit=coefficient.unit,
                windows=trend.windows,
                present=trend.present,
                p_value=trend.p_value,
                slope_per_day=trend.slope * SECONDS_PER_DAY,
                slope_std_per_day=trend.slope_std * SECONDS_PER_DAY,
                reach=_reach(reach, level, trend.lines.now_s) if reach else None,
            )
        )
    return found


def _reach(reach: Reach, level: str, now_s: float) -> ReachRecord:
    median_s, low_s, high_s = (
        time_s - now_s if math.isfinite(time_s) else None for time_s in (reach.time_s, reach.low_s, reach.high_s)
    )
    return ReachRecord(limit=reach.limit, level=level, median_s=median_s, low_s=low_s, high_s=high_s)


def _limits(own: Sequence[EstimateRecord]) -> list[tuple[float, str]]:
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
            limits += [(bound + severity * step, level.word) for severity, level in BOUNDS]
            break
    return limits
