"""When a diagnosis becomes an alarm: a pure state machine over the windows of a wheel.

One possible anomaly of one wheel has one alarm. Each decided window gives it a level on the scale normal, watch,
warning, distress, critical. The alarm's level is the highest that at least k of the last n windows reach, so that one
bad window raises no alarm. It clears only when it is normal again *and* acknowledged; an alarm that rises above what
was acknowledged must be acknowledged again (ISA-18.2). Time is the windows' own, except that of what a person does.
The silence of a wheel's monitor goes through the same machine, its reports in the place of windows.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final, Literal, NamedTuple

from rwa_monitor.messages import AlarmPhase, Anomaly, Diagnosis

MODEL_ALARM: Final = "model"  # the alarm that the friction model does not fit the wheel
STORED_ALARM: Final = " (stored)"  # behind the name of an alarm that stored telemetry raised: one of its own
MONITOR_ALARM: Final = "monitor"  # the alarm that the wheel is not watched: its monitor does not report
# In place of a wheel's name: of the alarm that all wheels of a spacecraft share, see `neighbours`.
ALL_WHEELS: Final = "all_wheels"


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
# Of alarms that are no anomaly of one wheel, at every level but normal.
OWN_ADVICE: Final = {
    ALL_WHEELS: (
        "All wheels moved together, so none is to be unloaded for this: look at their temperature, at the supply and"
        " calibration of the current sensors, and at what was commanded or changed at that time."
    ),
    MODEL_ALARM: (
        "The friction model does not fit: read the discrepancy report below the wheel, or run rwa-monitor discrepancy."
        " While friction grows, do not extend the wheel file: a drift can be the fault itself."
    ),
    MONITOR_ALARM: (
        "Nothing is diagnosed until the monitor is back: look whether rwa-monitor run still runs there, at the end of"
        " its log, and whether it reaches the bus (rwa-monitor doctor -e …). Started again with the same --record it"
        " goes on where it was, with all that publishers still hold; after that samples are lost."
    ),
}


STORED_ADVICE: Final = (
    "This is of earlier: stored telemetry showed it when it came, at the times given. Look at the windows since,"
    " and acknowledge it, which closes it; what the wheel is like now has an alarm of its own."
)


def advice(name: str, level: Level) -> str:
    """Return what to do about an alarm."""
    if name.endswith(STORED_ALARM):
        return STORED_ADVICE
    return OWN_ADVICE.get(name, ADVICE[level]) if level > Level.NORMAL else ADVICE[level]


# What the audit trail records. A person shelves an alarm for a while; the state machine goes on as if it was not.
EventKind = Literal[
    "raised", "escalated", "eased", "returned", "relapsed", "acknowledged", "cleared", "shelved", "unshelved"
]


class Policy(NamedTuple):
    """When windows make an alarm: a level counts when k of the last n decided windows reach it.

    Normal is when none of the last n is above it.
    """

    k: int
    n: int


WINDOW_POLICY: Final = Policy(k=2, n=3)
MONITOR_POLICY: Final = Policy(k=1, n=1)  # how long the silence must be is decided where the status is received
# Severities of an anomaly (0 at the nominal bound, 1 at the median of the learned anomaly) from which a window reaches
# a level; an active anomaly below is a watch.
BOUNDS: Final = ((0.5, Level.WARNING), (1.5, Level.DISTRESS), (3.0, Level.CRITICAL))


def level_of(anomaly: Anomaly, *, model_adequate: bool = True) -> Level:
    """Return the level that one anomaly of one window reaches.

    Where the friction model does not fit, only the severity that is certain to one standard deviation counts.
    """
    if not anomaly.active:
        return Level.NORMAL
    severity = anomaly.severity or 0.0
    if not model_adequate:
        severity -= anomaly.severity_std or 0.0
    return max((level for bound, level in BOUNDS if severity >= bound), default=Level.WATCH)


class Alarm(NamedTuple):
    """One alarm as it stands.

    Attributes
    ----------
    recent
        Levels of the last n decided windows, the oldest first.
    phase, level
        Where it stands now: active while nobody has acknowledged it, returned when it is normal again before that.
    peak
        The highest level since it was raised.
    acknowledged_level
        The level that a person has seen; NORMAL while none has.
    raised_ns, changed_ns
        Ends of the windows at which it was raised and last changed [ns, wheel's clock]; None while it is quiet.
    """

    recent: tuple[Level, ...] = ()
    phase: AlarmPhase = "quiet"
    level: Level = Level.NORMAL
    peak: Level = Level.NORMAL
    acknowledged_level: Level = Level.NORMAL
    raised_ns: int | None = None
    changed_ns: int | None = None


class AlarmEvent(NamedTuple):
    """A line of the audit trail: what happened, the level then, and when [ns, the wheel's clock]."""

    kind: EventKind
    level: Level
    time_ns: int


def observe(diagnosis: Diagnosis) -> dict[str, Level]:
    """Return the level that a window gives each alarm of its wheel: none if partial, none of the wheel if undecided."""
    fits = diagnosis.model_adequate
    if diagnosis.partial:
        return {}  # the end of a file, however short: it must not count like a whole window among k of n
    # A wrong model is no fault of the wheel, but its estimates of the wheel are then worth less.
    model = {MODEL_ALARM: Level.NORMAL if fits else Level.WATCH}
    if diagnosis.verdict == "inconclusive":
        return {} if fits else model  # a window that shows nothing does not show either that the model fits
    alarmed = diagnosis.verdict == "anomalous"
    levels = {
        name: level_of(anomaly, model_adequate=fits) if alarmed else Level.NORMAL
        for name, anomaly in diagnosis.anomalies.items()
    }
    return levels | model


def advance(alarm: Alarm, observed: Level, time_ns: int, policy: Policy) -> tuple[Alarm, list[AlarmEvent]]:
    """Take one window into an alarm.

    Parameters
    ----------
    alarm
        The alarm before it.
    observed, time_ns
        The level that the window gives it, and the window's end [ns, the wheel's clock].
    policy
        When windows make an alarm.

    Returns
    -------
    tuple
        The alarm after it, and the events to report.
    """
    recent = (*alarm.recent, observed)[-policy.n :]
    descending = sorted(recent, reverse=True)
    # The highest level that at least k of the last windows reach.
    level = descending[policy.k - 1] if len(descending) >= policy.k else Level.NORMAL
    if level == Level.NORMAL and alarm.phase != "quiet" and any(recent):
        level = min(alarm.level, Level.WATCH)  # still a bad window among the last n: it has not settled
    phase, kinds = _transition(alarm, level)
    events = [AlarmEvent(kind, level, time_ns) for kind in kinds]
    if phase == "quiet":
        return Alarm(recent), events
    return Alarm(
        recent,
        phase,
        level,
        max(alarm.peak, level),
        alarm.acknowledged_level,
        time_ns if alarm.phase == "quiet" else alarm.raised_ns,
        time_ns if events else alarm.changed_ns,
    ), events


def _transition(alarm: Alarm, level: Level) -> tuple[AlarmPhase, list[EventKind]]:
    """Return where a new level brings an alarm, and the events of it."""
    if alarm.phase in {"quiet", "returned"}:
        if level == Level.NORMAL:
            return alarm.phase, []
        return "active", ["raised" if alarm.phase == "quiet" else "relapsed"]
    if level == Level.NORMAL:
        return ("quiet", ["returned", "cleared"]) if alarm.phase == "acknowledged" else ("returned", ["returned"])
    if level > alarm.level:
        seen = alarm.phase == "acknowledged" and level <= alarm.acknowledged_level
        return "acknowledged" if seen else "active", ["escalated"]
    return alarm.phase, ["eased"] if level < alarm.level else []


def acknowledge(alarm: Alarm, time_ns: int) -> tuple[Alarm, list[AlarmEvent]]:
    """Note that somebody has seen an alarm; a quiet one, or one already seen, stays as it is.

    Parameters
    ----------
    alarm
        The alarm.
    time_ns
        The wheel's clock then: the end of the latest window.
    """
    seen = AlarmEvent("acknowledged", alarm.level, time_ns)
    if alarm.phase == "active":
        after = alarm._replace(phase="acknowledged", acknowledged_level=alarm.peak, changed_ns=time_ns)
        return after, [seen]
    if alarm.phase == "returned":
        return Alarm(alarm.recent), [seen, AlarmEvent("cleared", Level.NORMAL, time_ns)]
    return alarm, []
