"""When a diagnosis becomes an alarm: a pure state machine over the windows of a wheel.

One possible anomaly of one wheel has one alarm. Each decided window gives it a level on the scale normal, watch,
warning, distress, critical. The alarm's level is the highest that at least k of the last n windows reach, so that one
bad window raises no alarm. It clears only when it is normal again *and* acknowledged; an alarm that rises above what
was acknowledged must be acknowledged again (ISA-18.2). Time is the windows' own, except that of what a person does.
The silence of a wheel's monitor goes through the same machine, its reports in the place of windows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum, StrEnum
from typing import Final

from rwa_monitor.messages import Anomaly, Diagnosis

MODEL_ALARM: Final = "model"  # the alarm that the friction model does not fit the wheel
MONITOR_ALARM: Final = "monitor"  # the alarm that the wheel is not watched: its monitor does not report


class Level(IntEnum):
    """How bad it is, in the words of operations rooms."""

    NORMAL = 0
    WATCH = 1
    WARNING = 2
    DISTRESS = 3
    CRITICAL = 4

    @property
    def word(self) -> str:
        """The level as it is written in messages."""
        return self.name.lower()


# What to do at each level; the mission's own rules go before it. The levels are severities of friction, not orders.
ADVICE: Final = {
    Level.NORMAL: "Acknowledge it, and note what was the matter.",
    Level.WATCH: "Today: look at the next windows and the trend. Change nothing in operations.",
    Level.WARNING: (
        "In this shift: inform the attitude control engineer. Compare with temperature, with the other wheels and with"
        " the current at the same speed; look whether the wheel's trend has begun to rise."
    ),
    Level.DISTRESS: (
        "Within hours: unload this wheel to the speeds where its friction is least and away from zero crossings, check"
        " that the spacecraft points without it (redundant wheel, other actuators), and call in the bearing's maker."
    ),
    Level.CRITICAL: (
        "Now: go by the mission's procedure for a failing wheel (hand over to the redundant one, or safe mode, before"
        " it stops by itself)."
    ),
}
ADVICE_MODEL: Final = (
    "The friction model does not fit: read the discrepancy report below the wheel, or run rwa-monitor discrepancy."
    " While friction grows, do not extend the wheel file: a drift can be the fault itself."
)
ADVICE_MONITOR: Final = (
    "Nothing is diagnosed until the monitor is back: look whether rwa-monitor run still runs there, at the end of its"
    " log, and whether it reaches the bus (rwa-monitor doctor -e …). Started again with the same --record it goes on"
    " where it was, with all that publishers still hold; after that samples are lost."
)


def advice(name: str, level: Level) -> str:
    """Return what to do about an alarm."""
    if level > Level.NORMAL and name in {MODEL_ALARM, MONITOR_ALARM}:
        return ADVICE_MODEL if name == MODEL_ALARM else ADVICE_MONITOR
    return ADVICE[level]


class Phase(StrEnum):
    """Where an alarm stands between its rise and its end."""

    QUIET = "quiet"
    ACTIVE = "active"  # not yet acknowledged
    ACKNOWLEDGED = "acknowledged"  # and still not normal
    RETURNED = "returned"  # normal again, not yet acknowledged


class EventKind(StrEnum):
    """What the audit trail records."""

    RAISED = "raised"
    ESCALATED = "escalated"
    EASED = "eased"
    RETURNED = "returned"
    RELAPSED = "relapsed"
    ACKNOWLEDGED = "acknowledged"
    CLEARED = "cleared"
    SHELVED = "shelved"  # for a while, by a person; the state machine goes on as if it was not
    UNSHELVED = "unshelved"


@dataclass(frozen=True, slots=True)
class Policy:
    """When windows make an alarm.

    Attributes
    ----------
    k, n
        A level counts when k of the last n decided windows reach it; normal is when none of the last n is above it.
    warning, distress, critical
        Severity of an anomaly (0 at the nominal bound, 1 at the median of the learned anomaly) from which a window
        reaches that level; an active anomaly below is a watch.
    """

    k: int = 2
    n: int = 3
    warning: float = 0.5
    distress: float = 1.5
    critical: float = 3.0

    def __post_init__(self) -> None:
        """Check that the policy can raise an alarm, and that the levels are in order."""
        if not 1 <= self.k <= self.n:
            raise ValueError(f"k = {self.k} of n = {self.n} windows is impossible")
        if not 0.0 <= self.warning <= self.distress <= self.critical:
            raise ValueError("the severities of warning, distress and critical are not in order")

    def level_of(self, anomaly: Anomaly, *, model_adequate: bool = True) -> Level:
        """Return the level that one anomaly of one window reaches.

        Where the friction model does not fit, only the severity that is certain to one standard deviation counts.
        """
        if not anomaly.active:
            return Level.NORMAL
        severity = anomaly.severity or 0.0
        if not model_adequate:
            severity -= anomaly.severity_std or 0.0
        return max((level for bound, level in self.bounds if severity >= bound), default=Level.WATCH)

    @property
    def bounds(self) -> tuple[tuple[float, Level], ...]:
        """The severities from which on levels are reached, ascending."""
        return (self.warning, Level.WARNING), (self.distress, Level.DISTRESS), (self.critical, Level.CRITICAL)


MONITOR_POLICY: Final = Policy(k=1, n=1)  # how long the silence must be is decided where the status is received


@dataclass(frozen=True, slots=True)
class Observation:
    """The level that one window gives one alarm, and the window's end [ns, wheel's clock]."""

    level: Level
    time_ns: int


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm as it stands.

    Attributes
    ----------
    recent
        Levels of the last n decided windows, the oldest first.
    phase, level
        Where it stands now.
    peak
        The highest level since it was raised.
    acknowledged_level
        The level that a person has seen; NORMAL while none has.
    raised_ns, changed_ns
        Ends of the windows at which it was raised and last changed [ns, wheel's clock]; None while it is quiet.
    """

    recent: tuple[Level, ...] = ()
    phase: Phase = Phase.QUIET
    level: Level = Level.NORMAL
    peak: Level = Level.NORMAL
    acknowledged_level: Level = Level.NORMAL
    raised_ns: int | None = None
    changed_ns: int | None = None


@dataclass(frozen=True, slots=True)
class AlarmEvent:
    """A line of the audit trail: what happened, the level then, and when [ns, the wheel's clock]."""

    kind: EventKind
    level: Level
    time_ns: int


def observe(diagnosis: Diagnosis, policy: Policy) -> dict[str, Observation]:
    """Return what a window means for each alarm of its wheel: nothing of the wheel if undecided, nothing if partial."""
    time_ns, fits = diagnosis.window_end_ns, diagnosis.model_adequate
    if diagnosis.partial:
        return {}  # the end of a file, however short: it must not count like a whole window among k of n
    # A wrong model is no fault of the wheel, but its estimates of the wheel are then worth less.
    model = {MODEL_ALARM: Observation(Level.NORMAL if fits else Level.WATCH, time_ns)}
    if diagnosis.verdict == "inconclusive":
        return {} if fits else model  # a window that shows nothing does not show either that the model fits
    alarmed = diagnosis.verdict == "anomalous"
    observations = {
        name: Observation(policy.level_of(anomaly, model_adequate=fits) if alarmed else Level.NORMAL, time_ns)
        for name, anomaly in diagnosis.anomalies.items()
    }
    return observations | model


def advance(alarm: Alarm, observation: Observation, policy: Policy) -> tuple[Alarm, list[AlarmEvent]]:
    """Take one window into an alarm; returns the alarm after it and the events to report."""
    recent = (*alarm.recent, observation.level)[-policy.n :]
    level, time_ns = _level(recent, policy), observation.time_ns
    if level == Level.NORMAL and alarm.phase != Phase.QUIET and any(recent):
        level = min(alarm.level, Level.WATCH)  # still a bad window among the last n: it has not settled
    phase, kinds = _transition(alarm, level)
    events = [AlarmEvent(kind, level, time_ns) for kind in kinds]
    if phase == Phase.QUIET:
        return Alarm(recent), events
    return Alarm(
        recent,
        phase,
        level,
        max(alarm.peak, level),
        alarm.acknowledged_level,
        time_ns if alarm.phase == Phase.QUIET else alarm.raised_ns,
        time_ns if events else alarm.changed_ns,
    ), events


def _transition(alarm: Alarm, level: Level) -> tuple[Phase, list[EventKind]]:
    """Return where a new level brings an alarm, and the events of it."""
    if alarm.phase in {Phase.QUIET, Phase.RETURNED}:
        if level == Level.NORMAL:
            return alarm.phase, []
        return Phase.ACTIVE, [EventKind.RAISED if alarm.phase == Phase.QUIET else EventKind.RELAPSED]
    if level == Level.NORMAL:
        if alarm.phase == Phase.ACKNOWLEDGED:
            return Phase.QUIET, [EventKind.RETURNED, EventKind.CLEARED]
        return Phase.RETURNED, [EventKind.RETURNED]
    if level > alarm.level:
        seen = alarm.phase == Phase.ACKNOWLEDGED and level <= alarm.acknowledged_level
        return Phase.ACKNOWLEDGED if seen else Phase.ACTIVE, [EventKind.ESCALATED]
    return alarm.phase, [EventKind.EASED] if level < alarm.level else []


def acknowledge(alarm: Alarm, time_ns: int) -> tuple[Alarm, list[AlarmEvent]]:
    """Note that somebody has seen an alarm; a quiet one, or one already seen, stays as it is.

    Parameters
    ----------
    alarm
        The alarm.
    time_ns
        The wheel's clock then: the end of the latest window.
    """
    seen = AlarmEvent(EventKind.ACKNOWLEDGED, alarm.level, time_ns)
    if alarm.phase == Phase.ACTIVE:
        after = replace(alarm, phase=Phase.ACKNOWLEDGED, acknowledged_level=alarm.peak, changed_ns=time_ns)
        return after, [seen]
    if alarm.phase == Phase.RETURNED:
        return Alarm(alarm.recent), [seen, AlarmEvent(EventKind.CLEARED, Level.NORMAL, time_ns)]
    return alarm, []


def _level(recent: tuple[Level, ...], policy: Policy) -> Level:
    """Return the highest level that at least k of the last windows reach."""
    descending = sorted(recent, reverse=True)
    return descending[policy.k - 1] if len(descending) >= policy.k else Level.NORMAL
