"""From the judgement on each anomaly to the verdict on a window: its reason, and what helps where there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rwa_monitor.diagnosis import explanation
from rwa_monitor.diagnosis.adequacy import Adequacy
from rwa_monitor.diagnosis.classification import Judged
from rwa_monitor.diagnosis.window_diagnosis import AnomalyDiagnosis, DiagnosisInput, Verdict

MIN_COVERAGE: Final = 0.5  # share of the slots that must be used; below, the window shows little of what it missed
FIRST_WINDOWS: Final = 2  # an alarm begins in the second one at the earliest
# Learned anomalies have 1.2 to 2.2 times the nominal bound. What lies beyond from the first window on, or in so many
# parts at once, is more often a wheel file of another wheel.
FAR: Final = 3.0  # times the upper nominal bound, or a third of the lower one
MANY_PARTS: Final = 3
CLEAR_STDS: Final = 5.0  # beyond the nominal range, of the estimate itself
MIN_SHARE: Final = 0.1  # of a whole window's samples: with fewer, at the end of a file, it is called nominal by no rule


@dataclass(frozen=True, slots=True)
class Shown:
    """What a verdict asks beside the judgement.

    Attributes
    ----------
    unmoved
        For each anomaly whether it is that of a system without a jump in the window.
    deviations
        The standard deviation of each anomaly's estimate, in its unit.
    unnamed_jumps
        Whether friction jumps and the wheel file names no switching system.
    mean_speed_rad_s
        Mean |ω| of the used samples [rad/s].
    before
        Base dry and viscous friction as earlier windows show them, in their units; NaN where none does.
    """

    unmoved: tuple[bool, ...]
    deviations: tuple[float, ...]
    unnamed_jumps: bool
    mean_speed_rad_s: float
    before: tuple[float, float]


def verdict_of(
    inputs: DiagnosisInput,
    judged: Sequence[Judged],
    anomalies: Sequence[AnomalyDiagnosis],
    fits: Adequacy,
    shown: Shown,
) -> tuple[Verdict, str]:
    """Return the verdict and its reason. A found anomaly stands; what keeps a window from being nominal comes after."""
    nothing = nothing_to_judge(inputs)
    if nothing or inputs.model is None:
        return "inconclusive", nothing
    low, high = inputs.model.undecided
    leaning = [entry.name for entry in judged if entry.leans]
    # Where the friction model lacks something, only what the window shows for sure counts as found: what is missing
    # leaves base dry friction uncertain by its own size, and half of that lies above any nominal range.
    # And a system that made no jump is not distinguished from the base, or shows nothing at all.
    unsure = [
        not (entry.informative or fits.adequate) or jumpless
        for entry, jumpless in zip(judged, shown.unmoved, strict=True)
    ]
    certain = [
        anomaly
        for anomaly, entry, uncertain in zip(anomalies, judged, unsure, strict=True)
        if entry.active and entry.probability >= high and not uncertain
    ]
    if certain == [_exchanged(anomalies[0], anomalies[1], shown.mean_speed_rad_s)]:
        return "inconclusive", explanation.reason_exchanged(anomalies[0], anomalies[1])
    if certain:
        shown_before = [anomaly.name for anomaly in certain if anomaly.name in leaning]
        return "anomalous", explanation.reason_anomalous(certain, shown_before)
    lacking = lacking_of(fits, shown)
    for anomaly, entry, uncertain in zip(anomalies, judged, unsure, strict=True):
        what = explanation.title(entry.name)
        if _rested(anomaly) or not entry.known:
            continue
        if low < entry.probability and (entry.probability < high or uncertain):
            return "inconclusive", (
                f"Whether {what} is anomalous cannot be decided{lacking}: it is"
                f" {explanation.quantity(anomaly.estimate, anomaly.unit)}"
                f" (nominal {explanation.span(anomaly.nominal_low, anomaly.nominal_high, anomaly.unit)}),"
                f" probability of an anomaly {explanation.percent(entry.probability)}."
            )
        if entry.unlike:
            return "inconclusive", (
                f"The {what}, {explanation.quantity(anomaly.estimate, anomaly.unit)}, is unlike anything learned,"
                f" nominal ({explanation.span(anomaly.nominal_low, anomaly.nominal_high, anomaly.unit)}) or anomalous"
                f"{explanation.BELOW_NOMINAL if _below(anomaly) else ''}."
            )
    for anomaly, std in zip(anomalies, shown.deviations, strict=True):
        if _outside(anomaly, std, adequate=fits.adequate):
            return "inconclusive", explanation.reason_outside(anomaly, lacking, below=_below(anomaly))
    return without_anomaly(inputs, judged, anomalies, lacking)


def lacking_of(fits: Adequacy, shown: Shown) -> str:
    """Return the part of a reason on what the friction model or the wheel file lacks; "" where nothing."""
    if not fits.adequate:
        return f" while the friction model lacks something ({fits.finding})"
    return " while friction jumps and the wheel file names no switching system ([[fss]])" if shown.unnamed_jumps else ""


def without_anomaly(
    inputs: DiagnosisInput, judged: Sequence[Judged], anomalies: Sequence[AnomalyDiagnosis], lacking: str
) -> tuple[Verdict, str]:
    """Return verdict and reason of a window in which no anomaly is found: nominal, where it shows enough for that."""
    leaning = [entry.name for entry in judged if entry.leans]
    silent = [entry.name for entry in judged if entry.known and not entry.informative]
    if silent:
        return "inconclusive", explanation.reason_silent(silent, len(judged), lacking)
    unknown = [entry.name for entry in judged if not entry.known]
    if unknown:
        return "inconclusive", explanation.reason_unknown(unknown, lacking)
    whole = inputs.wheel.window.samples
    if inputs.evidence.used < MIN_SHARE * whole:
        return "inconclusive", (
            f"Nothing is anomalous in these {inputs.evidence.used} samples, but a whole window has {whole}: they are"
            " too few to call the wheel nominal."
        )
    return "nominal", explanation.reason_nominal(anomalies, leaning, lacking)


def from_another_wheel(
    inputs: DiagnosisInput, verdict: Verdict, anomalies: Sequence[AnomalyDiagnosis], shown: Shown
) -> bool:
    """Return whether friction is so far from the wheel file, from the first window on, that the file may be another's.

    It changes no judgement: a wheel that was monitored too late looks like this, too.
    """
    dry, viscous = anomalies[:2]
    if verdict == "nominal" or inputs.carried.windows >= FIRST_WINDOWS or nothing_to_judge(inputs):
        return False
    if _exchanged(dry, viscous, shown.mean_speed_rad_s) or any(map(_within, anomalies, shown.before)):
        return False  # what was nominal in the window before has come since then: the file fitted once
    clear = [
        one
        for one, std in zip(anomalies, shown.deviations, strict=True)
        if (one.active or _below(one)) and not _rested(one) and _outside(one, CLEAR_STDS * std, adequate=True)
    ]
    both = dry in clear and viscous in clear
    return both or len(clear) >= MANY_PARTS or any(_far(one) for one in clear if one in {dry, viscous})


def covered(inputs: DiagnosisInput) -> bool:
    """Return whether enough of the window's slots hold a usable sample for it to be judged."""
    return inputs.evidence.used >= MIN_COVERAGE * inputs.evidence.slots


def nothing_to_judge(inputs: DiagnosisInput) -> str:
    """Return why nothing can be judged, whatever the friction is; "" where it can."""
    if inputs.wheel.nominal is None:
        return "The wheel file has no [nominal], so there is nothing to compare the friction with."
    if inputs.model is None:
        return "There is no model, so no nominal range to compare the friction with."
    if not covered(inputs):
        share = 100.0 * inputs.evidence.used / inputs.evidence.slots
        return (
            f"Only {share:.0f} % of the window's slots hold a usable sample ({100.0 * MIN_COVERAGE:.0f} % are needed)."
        )
    return ""


def remedy_of(inputs: DiagnosisInput, anomalies: Sequence[AnomalyDiagnosis], shown: Shown, *, adequate: bool) -> str:
    """Return what helps an inconclusive window where waiting for the next one does not; "" where it does."""
    if inputs.wheel.nominal is None:
        return (
            "Friction, jumps and how well the model fits are measured; no part of it is judged. Learn the wheel file"
            " from healthy recordings with rwa-monitor identify, or add [nominal] to it."
        )
    if not covered(inputs):
        return explanation.CHECK_TELEMETRY
    if shown.unnamed_jumps:
        return "Learn its switching systems from longer recordings with rwa-monitor identify: waiting does not help."
    if adequate and any(_below(anomaly) and not anomaly.active for anomaly in anomalies[:2]):
        return "Friction hardly falls below nominal: check units, sign and the wheel file before the wheel."
    if inputs.model is not None and any(anomaly.nominal_low is None for anomaly in anomalies):
        return "State it in the wheel file, or learn it with rwa-monitor identify: waiting does not help."
    return ""


def _rested(anomaly: AnomalyDiagnosis) -> bool:
    """Return whether it is that of a system that rested throughout: no friction, healthy or not."""
    return anomaly.nominal_low == anomaly.nominal_high == 0.0


def _exchanged(dry: AnomalyDiagnosis, viscous: AnomalyDiagnosis, speed_rad_s: float) -> AnomalyDiagnosis | None:
    """Return that of the two whose excess the other lacks, so that the sum at the window's speed is nominal, or None.

    No healthy or failing wheel has much less than nominal friction. Where the speed hardly moves, noise of its
    measurement flattens the slope (errors in variables: Fuller 1987, section 1.1), and the base takes up the rest.
    """
    found = None
    for high, lacking, lever in ((dry, viscous, speed_rad_s), (viscous, dry, 1.0 / max(speed_rad_s, 1e-9))):
        bounds = (high.nominal_high, lacking.nominal_low, lacking.nominal_high)
        if high.estimate is None or lacking.estimate is None or None in bounds or not high.active:
            continue
        top, low_end, high_end = (float(bound or 0.0) for bound in bounds)
        # By a whole width of the range: healthy wheels have that nowhere.
        lacks = lacking.estimate < low_end - (high_end - low_end)
        if lacks and high.estimate - (0.5 * (low_end + high_end) - lacking.estimate) * lever <= top:
            found = high
    return found


def _below(anomaly: AnomalyDiagnosis) -> bool:
    return anomaly.estimate is not None and anomaly.nominal_low is not None and anomaly.estimate < anomaly.nominal_low


def _within(anomaly: AnomalyDiagnosis, value: float) -> bool:
    """Return whether a value, NaN for none, lies in an anomaly's nominal range while its estimate does not."""
    if anomaly.nominal_low is None or anomaly.nominal_high is None:
        return False
    return _outside(anomaly, 0.0, adequate=True) and anomaly.nominal_low <= value <= anomaly.nominal_high


def _far(anomaly: AnomalyDiagnosis) -> bool:
    estimate, low, high = anomaly.estimate or 0.0, anomaly.nominal_low or 0.0, anomaly.nominal_high or 0.0
    return estimate > FAR * high or estimate < low / FAR


def _outside(anomaly: AnomalyDiagnosis, std: float, *, adequate: bool) -> bool:
    """Return whether an estimate contradicts that its friction is nominal, `std` [the anomaly's unit] its deviation.

    It does outside the nominal range by more than that. Where the friction model does not fit, the deviation holds what
    is missing, and the range must hold all of it.
    """
    if anomaly.estimate is None or anomaly.nominal_low is None or anomaly.nominal_high is None:
        return False
    beyond = max(anomaly.estimate - anomaly.nominal_high, anomaly.nominal_low - anomaly.estimate)
    return beyond > (std if adequate else -std)
