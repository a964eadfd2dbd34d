"""What the simulation of a wheel gets wrong, as a search found it."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from rwa_monitor.messages.base import ClockNs, Count, Message, Name, Number


class Uncertain(Message):
    """A parameter of an effect; `note` is why it is not determined, where it is not (at its bound, …)."""

    value: Number
    std: Number | None
    unit: str
    note: str | None = None


class FoundEffect(Message):
    """An effect that the wheel's model lacks."""

    name: str
    family: Literal["mean", "noise", "switching"]
    equivalent: list[str]
    separate_by: str
    parameters: dict[str, Uncertain]
    p_value: Annotated[float, Field(ge=0, le=1)]
    delta_deviance: Number
    formula: str | None = None


class Unexplained(Message):
    """Something is left that no known effect explains."""

    signature: str
    size_Nm: Number


class Untested(Message):
    """An effect that this data cannot test, and the channel or manoeuvre it lacks."""

    effect: str
    missing: str


class DiagnosisQuality(Message):
    """Detection and false positive rates of the diagnosis, and false changepoints per window where counted."""

    detection: Number
    false_positive: Number
    false_changepoints: Number | None = None


class DiagnosisGain(Message):
    """Quality of the diagnosis without and with the effects found."""

    before: DiagnosisQuality
    after: DiagnosisQuality


class SimulatedGain(Message):
    """RMSE of the wheel file simulated on the searched records without and with the effects; `note` if it is worse."""

    rmse_base_Nm: Number
    rmse_extended_Nm: Number
    note: str = ""


class SearchedAgain(Message):
    """What a search of a part of the data finds, and gains on the rest (`held_out`), of which it saw nothing."""

    effects: list[Name]
    held_out: list[str]
    rmse_base_Nm: Number
    rmse_extended_Nm: Number
    log_score_base: Number
    log_score_extended: Number


class Gain(Message):
    """What the effects found are worth on held-out data: recordings named, or blocks of the searched ones."""

    rmse_base_Nm: Number
    rmse_extended_Nm: Number
    log_score_base: Number
    log_score_extended: Number
    noise_std_Nm: Number
    changepoints_base: Count
    changepoints_extended: Count
    diagnosis: DiagnosisGain | None
    simulated: SimulatedGain | None = None
    held_out: list[str] = Field(default=[])
    searched_again: SearchedAgain | None = None


class Discrepancy(Message):
    """What the simulation of a wheel gets wrong, the strongest effect first; from the samples start_ns … end_ns."""

    kind: ClassVar[str] = "discrepancy"

    spacecraft: Name
    wheel: Name
    start_ns: ClockNs
    end_ns: ClockNs
    verdict: Literal["adequate", "inadequate", "untestable"]
    effects: list[FoundEffect]
    unexplained: Unexplained | None
    untested: list[Untested]
    gain: Gain | None
