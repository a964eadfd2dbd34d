"""When a diagnosis becomes an alarm: a pure state machine over the windows of a wheel.

Each possible anomaly of a wheel has one alarm. Each decided window gives it a level on the scale normal, watch,
warning, distress, critical. The alarm's level is the highest that at least k of the last n windows reach, so that one
bad window raises no alarm. It clears only when it is normal again *and* acknowledged; an alarm that rises above the
acknowledged level must be acknowledged again (ISA-18.2). Times are those of the windows, on the wheel's clock. The
silence of a wheel's monitor uses the same state machine, with its reports in the place of windows.

Before that a wheel is compared with its siblings: a shift in all wheels of a spacecraft is no fault of one of them.
"""

import math
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Final, Literal, NamedTuple

import numpy as np

from rwa_monitor.kernels.noise import CHI_MEDIAN
from rwa_monitor.messages import AlarmPhase, Anomaly, Diagnosis
from rwa_monitor.samples import BoolArray, FloatArray

MODEL_ALARM: Final = "model"  # the alarm that the friction model does not fit the wheel
STORED_ALARM: Final = " (stored)"  # suffix of the name of an alarm from stored telemetry, separate from the live one
MONITOR_ALARM: Final = "monitor"  # the alarm that the wheel is not watched: its monitor does not report
# In place of a wheel's name for alarms that all wheels of a spacecraft share, see `compare_shifts`.
ALL_WHEELS: Final = "all_wheels"


class Level(IntEnum):
    """Level of an alarm, in the terms of spacecraft operations."""

    NORMAL = 0
    WATCH = 1
    WARNING = 2
    DISTRESS = 3
    CRITICAL = 4

    @property
    def word(self) -> str:
        """The level as in messages."""
        return self.name.lower()


# What to do at each level; the mission's own rules take precedence. Levels are severities of friction, not orders.
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
# Advice for alarms that are not an anomaly of one wheel, at every level but normal.
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


# Events of the audit trail. A person may shelve an alarm for a while, which does not affect the state machine.
EventKind = Literal[
    "raised", "escalated", "eased", "returned", "relapsed", "acknowledged", "cleared", "shelved", "unshelved"
]


class Policy(NamedTuple):
    """When windows raise an alarm: its level is the highest that k of the last n decided windows reach.

    A raised alarm returns to normal when all of the last n are normal.
    """

    k: int
    n: int


WINDOW_POLICY: Final = Policy(k=2, n=3)
MONITOR_POLICY: Final = Policy(k=1, n=1)  # the receiver of the status decides from which silence on
# Severities of an anomaly (0 at the nominal bound, 1 at the median of the learned anomaly) from which a window reaches
# a level; an active anomaly below them is a watch.
BOUNDS: Final = ((0.5, Level.WARNING), (1.5, Level.DISTRESS), (3.0, Level.CRITICAL))


def level_of(anomaly: Anomaly, *, model_adequate: bool = True) -> Level:
    """Return the level that one anomaly of one window reaches.

    Where the friction model does not fit, one standard deviation is subtracted from the severity.
    """
    if not anomaly.active:
        return Level.NORMAL
    severity = anomaly.severity or 0.0
    if not model_adequate:
        severity -= anomaly.severity_std or 0.0
    return max((level for bound, level in BOUNDS if severity >= bound), default=Level.WATCH)


class Alarm(NamedTuple):
    """State of one alarm.

    Attributes
    ----------
    recent
        Levels of the last n decided windows, the oldest first.
    phase, level
        Its current state: active until it is acknowledged, returned if it is normal again before that.
    peak
        The highest level since it was raised.
    acknowledged_level
        The peak when a person acknowledged it; NORMAL before that.
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
    """A line of the audit trail: the event, the level after it, and its time [ns, the wheel's clock]."""

    event: EventKind
    level: Level
    time_ns: int


def observe(diagnosis: Diagnosis) -> dict[str, Level]:
    """Return the level that a window gives each alarm; none if it is partial, or inconclusive and the model fits."""
    fits = diagnosis.model_adequate
    if diagnosis.partial:
        return {}  # a partial window may be very short: it must not count like a whole one among k of n
    # An inadequate model is no fault of the wheel, but makes the estimates less reliable.
    model = {MODEL_ALARM: Level.NORMAL if fits else Level.WATCH}
    if diagnosis.verdict == "inconclusive":
        return {} if fits else model  # an inconclusive window is no evidence that the model fits
    alarmed = diagnosis.verdict == "anomalous"
    levels = {
        name: level_of(anomaly, model_adequate=fits) if alarmed else Level.NORMAL
        for name, anomaly in diagnosis.anomalies.items()
    }
    return levels | model


def advance(alarm: Alarm, observed: Level, time_ns: int, policy: Policy) -> tuple[Alarm, list[AlarmEvent]]:
    """Update an alarm with one window.

    Parameters
    ----------
    alarm
        The alarm before the window.
    observed, time_ns
        The level that the window gives it, and the window's end [ns, the wheel's clock].
    policy
        When windows raise an alarm.

    Returns
    -------
    tuple
        The alarm after the window, and the events to report.
    """
    recent = (*alarm.recent, observed)[-policy.n :]
    descending = sorted(recent, reverse=True)
    # The highest level that at least k of the last windows reach.
    level = descending[policy.k - 1] if len(descending) >= policy.k else Level.NORMAL
    if level == Level.NORMAL and alarm.phase != "quiet" and any(recent):
        level = min(alarm.level, Level.WATCH)  # not normal while a bad window is among the last n
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
    """Return the phase of an alarm at a new level, and the events."""
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
    """Acknowledge an alarm; a quiet or acknowledged one is not changed.

    Parameters
    ----------
    alarm
        The alarm.
    time_ns
        Time of the acknowledgement on the wheel's clock: the end of the latest window.
    """
    seen = AlarmEvent("acknowledged", alarm.level, time_ns)
    if alarm.phase == "active":
        after = alarm._replace(phase="acknowledged", acknowledged_level=alarm.peak, changed_ns=time_ns)
        return after, [seen]
    if alarm.phase == "returned":
        return Alarm(alarm.recent), [seen, AlarmEvent("cleared", Level.NORMAL, time_ns)]
    return alarm, []


# ---- comparison of a wheel with its siblings -------------------------------------------------------------------------
# Whether a coefficient shifted in all wheels of a spacecraft, or in one.
#
# Wheels of one spacecraft share temperature, slews, bus voltage and software. A coefficient of each is compared with
# its earlier value: the relative shift r of the latest window against the median of earlier windows that were not
# anomalous. Under each hypothesis the shifts are jointly Gaussian, with variance S² where there is a shift:
#
#     no shift               r ~ N(0, D)                       D: error of the estimates, scatter from window to window
#     a common cause         r ~ N(0, D + S² 1 1ᵀ)
#     wheel i alone          r ~ N(0, D + S² eᵢ eᵢᵀ)
#     both                   r ~ N(0, D + S² (1 1ᵀ + eᵢ eᵢᵀ))
#
# Bayes' rule gives their probabilities. Of two wheels, a common shift with one exception cannot be distinguished from
# a shift of one: three are needed.


COMPARED: Final = {"dry": "base dry friction", "viscous": "viscous friction"}  # coefficients, and their names in words
FEWEST_WHEELS: Final = 3
MOST_WHEELS: Final = 16  # more are no siblings, but a fleet under one name
MIN_CERTAINTY: Final = 0.95  # probability from which a shift counts as common, or as that of one wheel alone
FEWEST_EARLIER: Final = 5  # windows that a wheel is compared with; with fewer, the nominal bounds are used
LATEST: Final = WINDOW_POLICY.n  # windows left out of the earlier ones: those that the alarm is raised from
MOST_EARLIER: Final = 48  # windows; four days of 2.2 hours each
SHIFT_STD: Final = 0.2  # S, relative standard deviation of a shift if there is one; learned anomalies are 15 to 30 %
BOUNDS_APART: Final = 4.0  # standard deviations of healthy wheels between the nominal bounds, that is ±2
MIN_SCATTER: Final = 0.005  # lower limit of a coefficient's relative standard deviation from window to window
PRIOR_COMMON: Final = 0.05  # prior probability of a common cause in the latest windows
PRIOR_ALONE: Final = 0.02  # prior probability, for each wheel, that it shifted alone


class Shift(NamedTuple):
    """Shift of a coefficient of one wheel, relative to its earlier value.

    Attributes
    ----------
    value, variance
        The shift, and its variance [-].
    nominal
        Half the width of the nominal range, relative to the earlier value [-].
    """

    value: float
    variance: float
    nominal: float


class Comparison(NamedTuple):
    """Comparison of the shifts of siblings.

    Attributes
    ----------
    common
        Probability of a common cause.
    shift, shift_std
        Mean and standard deviation of the common shift, given that there is one [-].
    alone
        float64 (wheels,), probability that each has a shift of its own, with or without a common one.
    """

    common: float
    shift: float
    shift_std: float
    alone: FloatArray


def shift_of(values: FloatArray, stds: FloatArray, anomalous: BoolArray, nominal: tuple[float, float]) -> Shift | None:
    """Return the shift in a wheel's latest window; None if the coefficient, or its earlier value, is not known.

    Parameters
    ----------
    values, stds
        float64 (windows,), the coefficient in each window, the oldest first, and its standard deviation; NaN where a
        window does not determine it.
    anomalous
        bool (windows,), where it was judged anomalous: such windows do not count for the earlier value.
    nominal
        Nominal bounds; their middle is used where there are too few earlier windows.
    """
    latest, std = float(values[-1]), float(stds[-1])
    if not np.isfinite(latest + std):
        return None
    earlier = values[:-LATEST][~anomalous[:-LATEST] & np.isfinite(values[:-LATEST])]
    if earlier.size >= FEWEST_EARLIER:
        was = float(np.median(earlier))
        scatter = max(float(np.median(np.abs(earlier - was))) / math.sqrt(CHI_MEDIAN), MIN_SCATTER * was)
        # The median of n windows has π/2 times the variance of their mean.
        variance = scatter**2 * (1.0 + 0.5 * np.pi / earlier.size)
    else:
        was, variance = 0.5 * sum(nominal), ((nominal[1] - nominal[0]) / BOUNDS_APART) ** 2
    if not was > 0.0:  # NaN too: neither earlier windows nor bounds
        return None
    return Shift(latest / was - 1.0, (std**2 + variance) / was**2, 0.5 * (nominal[1] - nominal[0]) / was)


def compare(shifts: Sequence[Shift]) -> Comparison | None:
    """Return the posterior probabilities of the hypotheses; None with fewer than three wheels."""
    count = len(shifts)
    if count < FEWEST_WHEELS:
        return None
    r = np.array([shift.value for shift in shifts])
    # One row for each hypothesis: whether there is a common cause, and which wheel has a shift of its own.
    shared = np.repeat([False, True], count + 1)
    alone = np.tile(np.vstack([np.zeros(count), np.eye(count)]), (2, 1))
    moved = shared[:, None, None] + alone[:, :, None] * alone[:, None, :]
    covariance = np.diag([shift.variance for shift in shifts]) + SHIFT_STD**2 * moved
    inverse = np.linalg.inv(covariance)
    prior = np.where(shared, np.log(PRIOR_COMMON), np.log(1.0 - PRIOR_COMMON))
    prior += np.where(alone.any(axis=1), np.log(PRIOR_ALONE), np.log(1.0 - count * PRIOR_ALONE))
    log_weight = prior - 0.5 * (r @ inverse @ r + np.linalg.slogdet(covariance)[1])
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    # Posterior mean and variance of the common shift, under each hypothesis that has one.
    gain = SHIFT_STD**2 * inverse[shared].sum(axis=1)
    means, variances = gain @ r, SHIFT_STD**2 * (1.0 - gain.sum(axis=1))
    common = float(weight[shared].sum())
    of_these = weight[shared] / max(common, np.finfo(float).tiny)
    shift = float(of_these @ means)
    variance = float(of_these @ (variances + (means - shift) ** 2))
    return Comparison(common, shift, float(np.sqrt(max(variance, 0.0))), weight @ alone)


class ShiftComparison(NamedTuple):
    """The shift of one wheel's coefficient compared with its siblings.

    Attributes
    ----------
    common
        The least level of the alarm of all wheels if the shift has a common cause: a watch if it is more than half the
        width of the nominal range. None where that is not certain.
    is_alone
        Whether it is certain that the shift is the wheel's own.
    in_words
        One sentence for an operator.
    """

    common: Level | None
    is_alone: bool
    in_words: str


def compare_shifts(name: str, wheel: str, shifts: Mapping[str, Shift]) -> ShiftComparison | None:
    """Compare a wheel with its siblings, by the shifts of all; None where they are too few, or it has none.

    Parameters
    ----------
    name
        Of the coefficient, one of `COMPARED`.
    wheel
        The wheel that is compared with the others.
    shifts
        By wheel.
    """
    names = sorted(shifts)
    found = compare([shifts[one] for one in names])
    if found is None or wheel not in shifts:
        return None
    coefficient, alone = COMPARED[name].capitalize(), float(found.alone[names.index(wheel)]) >= MIN_CERTAINTY
    if alone or found.common < MIN_CERTAINTY:
        moved = _percent(shifts[wheel].value, shifts[wheel].variance ** 0.5)
        words = f"{coefficient} moved by {moved}, apart from that of the other {len(names) - 1} wheels."
        return ShiftComparison(common=None, is_alone=alone, in_words=words)
    words = (
        f"{coefficient} of all {len(names)} wheels moved by {_percent(found.shift, found.shift_std)}: a cause outside"
        " the wheels, such as temperature, the supply of the current sensors, or a change of software."
    )
    large = abs(found.shift) > float(np.median([shift.nominal for shift in shifts.values()]))
    return ShiftComparison(Level.WATCH if large else Level.NORMAL, is_alone=False, in_words=words)


def _percent(value: float, std: float) -> str:
    return f"{100.0 * value:+.1f} ± {100.0 * std:.1f} %"
