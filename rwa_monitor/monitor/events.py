"""What a wheel's monitor core says: its events, in the order in which they happen."""

from __future__ import annotations

from dataclasses import dataclass

from rwa_monitor.diagnosis.window_diagnosis import WindowDiagnosis
from rwa_monitor.monitor.ingest.sequencer import MessagesMissed, PublisherChanged, PublisherConflict
from rwa_monitor.switching.carried_state import CarriedState


@dataclass(frozen=True, slots=True)
class EpochStarted:
    """The slot grid begins anew: the wheel's first sample, or a clock step of more than a window.

    Attributes
    ----------
    origin_ns
        Time of slot 0.
    step_ns
        By how much the clock stepped; 0 at the first sample.
    """

    origin_ns: int
    step_ns: int


@dataclass(frozen=True, slots=True)
class ProvisionalChangepoint:
    """A jump of friction, as soon as it is confirmed; the window's diagnosis has the last word on it.

    Attributes
    ----------
    window_start_ns
        Of the window it lies in.
    index, time_ns
        First slot of the new level, within the window, and its time.
    jump_Nm, std_Nm
        Size, positive up, and its standard deviation.
    confidence
        Probability that noise alone has no such jump in a whole window.
    """

    window_start_ns: int
    index: int
    time_ns: int
    jump_Nm: float
    std_Nm: float
    confidence: float


@dataclass(frozen=True, slots=True)
class WindowDiagnosed:
    """A window was closed and diagnosed.

    Attributes
    ----------
    start_ns, end_ns, period_ns
        The window is [start, end): `end_ns` is the time of the first slot after it.
    partial
        True where samples or an epoch ended before the window was full.
    diagnosis
        What it says.
    carried
        The wheel's state after it.
    """

    start_ns: int
    end_ns: int
    period_ns: int
    partial: bool
    diagnosis: WindowDiagnosis
    carried: CarriedState


@dataclass(frozen=True, slots=True)
class ChannelMissing:
    """A message lacks the channel that this wheel's friction comes from; its samples are masked."""

    channel: str


@dataclass(frozen=True, slots=True)
class StraySamples:
    """Samples whose time agrees with neither the sample before nor the one after; they were rejected.

    Attributes
    ----------
    count
        How many in a row of messages.
    time_ns
        Time of the first.
    """

    count: int
    time_ns: int


@dataclass(frozen=True, slots=True)
class SensorFault:
    """A channel shows what no wheel does; such slots are masked.

    Attributes
    ----------
    channel
        Which one.
    hangs
        True at the first slot in which it repeats one value too often, False for a slot that stands out.
    time_ns
        Of the slot.
    """

    channel: str
    hangs: bool
    time_ns: int


@dataclass(frozen=True, slots=True)
class SamplePeriodDiffers:
    """The samples come in other steps than the wheel file says.

    Attributes
    ----------
    period_s, expected_s
        Median step of the first samples, and the wheel file's sample period [s].
    """

    period_s: float
    expected_s: float


@dataclass(frozen=True, slots=True)
class SpeedsBeyondLimit:
    """Many speeds are beyond the wheel's limit, where their samples are rejected.

    Attributes
    ----------
    limit_rad_s, largest_rad_s
        The limit, and the largest so far, as if it were in rad/s.
    """

    limit_rad_s: float
    largest_rad_s: float


Event = (
    EpochStarted
    | ProvisionalChangepoint
    | WindowDiagnosed
    | ChannelMissing
    | StraySamples
    | SensorFault
    | SamplePeriodDiffers
    | SpeedsBeyondLimit
    | PublisherChanged
    | PublisherConflict
    | MessagesMissed
)
