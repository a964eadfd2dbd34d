"""From the judgement on each anomaly to the verdict on a window: its reason, a remedy, and words for an operator.

The reason is one sentence, the explanation two or three to act on. They state numbers.
"""

import math
from collections.abc import Sequence
from typing import Final

from rwa_monitor.diagnosis.findings import DRY_UNIT, AnomalyDiagnosis, DiagnosisInput, Findings
from rwa_monitor.messages import Verdict
from rwa_monitor.wheel.wheel import Wheel
from rwa_monitor.words import counted

# What to look at, by anomaly. Dry friction is contact, viscous friction the lubricant (paper, section III-A).
_ACTION = {
    "dry": "Check the bearing's lubrication; keep the wheel away from zero speed until the cause is understood.",
    "viscous": "Check the lubricant: compare with bearing temperature and age before blaming wear.",
}
_ACTION_SYSTEM = "Check for cage or oil-pocket trouble: compare the size and rate of its jumps with earlier windows."
_ACTION_MODEL = (
    "Run rwa-monitor discrepancy on this window for the name of what is missing; until then statements on the wheel's"
    " health are less reliable. A drift can be the fault itself: do not extend the wheel file while friction moves,"
    " compare with the last healthy windows."
)
_ACTION_MODEL_TOO = (
    "rwa-monitor discrepancy may name what is missing, but what it finds can be the fault itself: do not extend the"
    " wheel file by it before that is ruled out."
)
CHECK_TELEMETRY: Final = "Check the telemetry link and the sensors before the wheel."
WORTH_NAMING: Final = 0.1  # probability from which another anomaly is named in addition to the one diagnosed
_NEVER_RESTED = (  # the words are those of the reference recordings
    "A switching system never rested in this window, so base dry friction and its own were told apart by learned"
    " ranges and earlier windows only."
)


def quantity(value: float | None, unit: str) -> str:
    """Write a value with three significant digits; torques with a prefix, as in `1.62 mN m`."""
    if value is None or not math.isfinite(value):
        return "unknown"
    for scale, prefix in ((1.0, ""), (1e3, "m"), (1e6, "µ")) if unit == DRY_UNIT else ():
        if abs(value) * scale >= 0.1:
            return f"{value * scale:.3g} {prefix}{unit}"
    return f"{value:.3g} {unit}"


def span(low: float | None, high: float | None, unit: str) -> str:
    """Write a range, as in `1.51 mN m to 1.69 mN m`."""
    return f"{quantity(low, unit)} to {quantity(high, unit)}"


def percent(probability: float) -> str:
    """Write a probability without claiming certainty."""
    if probability > 0.999:
        return "more than 99.9 %"
    if probability < 0.001:
        return "less than 0.1 %"
    return f"{100.0 * probability:.3g} %"


def title(name: str) -> str:
    """Return what an anomaly's friction is called in a sentence."""
    return {"dry": "base dry friction", "viscous": "viscous friction"}.get(name, f"friction of switching system {name}")


def listed(names: Sequence[str]) -> str:
    """Return what the anomalies' friction is called, as a list in a sentence."""
    titles = [title(name) for name in names]
    return titles[0] if len(titles) == 1 else f"{', '.join(titles[:-1])} and {titles[-1]}"


def explain(findings: Findings, verdict: Verdict, reason: str) -> str:
    """Return two or three plain sentences an operator can act on, the reason first."""
    remedy = remedy_of(findings) if verdict == "inconclusive" else ""
    worst = max((one for one in findings.anomalies if one.active), key=lambda one: one.severity or 0.0, default=None)
    qualification = ""
    if verdict == "anomalous" and worst is not None:
        qualification = _alternatives(findings) or (_severity(worst) if findings.base_known else _NEVER_RESTED)
        action = _ACTION.get(worst.name, _ACTION_SYSTEM)
    elif verdict == "nominal":
        qualification = "" if findings.base_known else _NEVER_RESTED
        earlier = "there is no earlier window to compare with"
        carried = findings.inputs.carried
        if carried.windows and findings.inputs.method == "joint":
            earlier = f"{counted(carried.windows, 'earlier window')} of this wheel went into this"
        action = f"No action is needed; {earlier}."
    else:
        action = remedy or "Wait for the next window, or give this one more samples, before acting."
    if (spread := viscous_spread(findings.inputs.wheel)) and verdict != "anomalous":
        qualification = f"{qualification} {spread}".strip()
    fits = findings.fits
    if not fits.adequate and not remedy:
        suspect = f", {fits.suspected_effect} is suspected" if fits.suspected_effect else ""
        qualification = f"The friction model lacks something this wheel has: {fits.finding}{suspect}."
        action = f"{action} {_ACTION_MODEL_TOO}" if verdict == "anomalous" else _ACTION_MODEL
    return " ".join(sentence for sentence in (reason, qualification, action) if sentence)


def viscous_spread(wheel: Wheel) -> str:
    """Return a sentence on the use of a temperature, where viscous friction is judged by its spread; else ""."""
    spread = wheel.nominal.viscous_spread if wheel.nominal else None
    if not spread:
        return ""
    return (
        f"Viscous friction differs by ±{100.0 * spread:.2g} % between healthy recordings, and only what lies beyond"
        " that is judged: with the bearing's temperature recorded, identify learns how much of it is heat."
    )


def _alternatives(findings: Findings) -> str:
    """Return a sentence on the anomalies that it could be instead, "" where none is likely."""
    alternatives = [one for one in findings.anomalies if not one.active and one.probability > WORTH_NAMING]
    if not alternatives:
        return ""
    names = " or ".join(f"{title(one.name)} ({percent(one.probability)})" for one in alternatives)
    why = "" if findings.base_known else ", since a switching system never rested in it"
    return f"It may be {names} instead: this window alone cannot fully distinguish them{why}."


def _severity(anomaly: AnomalyDiagnosis) -> str:
    if anomaly.severity is None or anomaly.severity_std is None:
        return ""
    return (
        f"The severity of {anomaly.name} is {anomaly.severity:.2g} ± {anomaly.severity_std:.1g}"
        " (0 at the nominal bound, 1 at the typical learned anomaly)."
    )


MIN_COVERAGE: Final = 0.5  # share of the slots that must be used; below, the window does not represent its time
MIN_SHARE: Final = 0.1  # of a whole window's samples: with fewer, at the end of a file, it is never called nominal
BELOW_NOMINAL: Final = ": below nominal, so check units, sign or the wheel file"


def verdict_of(findings: Findings) -> tuple[Verdict, str]:
    """Return the verdict and its reason. Certain anomalies come first, then what rules out a nominal verdict."""
    inputs, adequate, lacking = findings.inputs, findings.fits.adequate, findings.lacking
    nothing = nothing_to_judge(inputs)
    if nothing or inputs.model is None:
        return "inconclusive", nothing
    low, high = inputs.model.undecided
    # Where the friction model lacks something, only informative estimates make an anomaly certain: the missing effect
    # makes base dry friction uncertain by its own size, and half of that distribution lies above any nominal range.
    # And a system that made no jump is not separable from the base, or, at rest, gives no information.
    unsure = {one.name for one in findings.anomalies if one.unmoved or not (one.informative or adequate)}
    certain = [one for one in findings.anomalies if one.active and one.probability >= high and one.name not in unsure]
    if certain == [_exchanged(findings)]:
        parts = " and ".join(f"{title(one.name)} ({_estimate(one)}, {_nominal(one)})" for one in findings.anomalies[:2])
        return "inconclusive", _sentence(f"{parts} cannot be distinguished at these speeds: together they are nominal")
    if certain:
        return "anomalous", reason_anomalous(certain)
    for one in findings.anomalies:
        rested = one.nominal_low == one.nominal_high == 0.0  # throughout: no friction, healthy or not
        if rested or not one.known:
            continue
        if low < one.probability and (one.probability < high or one.name in unsure):
            return "inconclusive", (
                f"Whether {title(one.name)} is anomalous cannot be decided{lacking}: it is {_estimate(one)}"
                f" ({_nominal(one)}), probability of an anomaly {percent(one.probability)}"
                f"{findings.because_of_temperature([one.name])}."
            )
        if one.unfamiliar:
            return "inconclusive", (
                f"The {title(one.name)}, {_estimate(one)}, is unlike anything learned, nominal"
                f" ({_range(one)}) or anomalous{BELOW_NOMINAL if _below(one) else ''}."
            )
    for one in findings.anomalies:
        if _outside(one, adequate=adequate):
            where = "may lie" if lacking else "lies"
            return "inconclusive", _sentence(
                f"{title(one.name)}, {_estimate(one)}, {where} outside its nominal range ({_range(one)}){lacking},"
                f" although it does not look like a learned anomaly (probability {percent(one.probability)})"
                f"{BELOW_NOMINAL if _below(one) else ''}"
            )
    return without_anomaly(findings)


def reason_anomalous(active: Sequence[AnomalyDiagnosis]) -> str:
    """Return the reason of an anomalous verdict: every anomaly with its numbers, the most severe first."""
    ordered = sorted(active, key=lambda one: -(one.severity or 0.0))
    parts = "; ".join(f"{title(one.name)} is {_assessed(one)}" for one in ordered)
    return _sentence(parts + _leaning(active))


def without_anomaly(findings: Findings) -> tuple[Verdict, str]:
    """Return verdict and reason of a window in which no anomaly is found: nominal, if it is informative enough."""
    anomalies, lacking = findings.anomalies, findings.lacking
    silent = [one.name for one in anomalies if one.known and not one.informative]
    why = f"{lacking}{findings.because_of_temperature(silent)}"
    if len(silent) == len(anomalies):
        return "inconclusive", f"The window shows none of the wheel's coefficients well enough to judge them{why}."
    if silent:
        return "inconclusive", f"Nothing else is anomalous, but the window does not show {listed(silent)}{why}."
    unknown = [one.name for one in anomalies if not one.known]
    if unknown:
        return "inconclusive", (
            f"Nothing else is anomalous, but no file states how large healthy {listed(unknown)} is{lacking}."
        )
    used, whole = findings.inputs.evidence.used, findings.inputs.wheel.window.samples
    if used < MIN_SHARE * whole:
        return "inconclusive", (
            f"Nothing is anomalous in these {used} samples, but a whole window has {whole}: they are too few to call"
            " the wheel nominal."
        )
    worst = max(anomalies, key=lambda one: one.probability)
    what = f"friction is nominal{lacking}" if lacking else "all friction is nominal"
    return "nominal", _sentence(
        f"{what}; the most suspect, {title(worst.name)}, is {_assessed(worst)}{_leaning(anomalies)}"
    )


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


def remedy_of(findings: Findings) -> str:
    """Return the remedy for an inconclusive window where waiting for the next one does not help; "" where it does."""
    inputs, anomalies = findings.inputs, findings.anomalies
    if inputs.wheel.nominal is None:
        return (
            "Friction, jumps and how well the model fits are measured; no part of it is judged. Learn the wheel file"
            " from healthy recordings with rwa-monitor identify, or add [nominal] to it."
        )
    if not covered(inputs):
        return CHECK_TELEMETRY
    if findings.unnamed_jumps:
        return "Learn its switching systems from longer recordings with rwa-monitor identify: waiting does not help."
    if findings.fits.adequate and any(_below(one) and not one.active for one in anomalies[:2]):
        return "Friction hardly falls below nominal: check units, sign and the wheel file before the wheel."
    if inputs.model is not None and any(one.nominal_low is None for one in anomalies):
        return "State it in the wheel file, or learn it with rwa-monitor identify: waiting does not help."
    viscous = anomalies[1]
    at_one_speed = viscous.known and not (viscous.informative or findings.because_of_temperature([viscous.name]))
    if at_one_speed and findings.fits.adequate:
        return "A change of speed shows it: rwa-monitor manoeuvre viscous gives the shortest one that decides."
    return ""


# ---- parts of a reason -----------------------------------------------------------------------------------------------


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _estimate(one: AnomalyDiagnosis) -> str:
    return quantity(one.estimate, one.unit)


def _range(one: AnomalyDiagnosis) -> str:
    return span(one.nominal_low, one.nominal_high, one.unit)


def _nominal(one: AnomalyDiagnosis) -> str:
    return f"nominal {_range(one)}"


def _assessed(one: AnomalyDiagnosis) -> str:
    return f"{_estimate(one)} ({_nominal(one)}, probability of an anomaly {percent(one.probability)})"


def _leaning(anomalies: Sequence[AnomalyDiagnosis]) -> str:
    """Return the end of a reason, on the anomalies judged by earlier windows; "" for none."""
    names = [one.name for one in anomalies if one.relies_on_earlier]
    return f"; this window alone does not show {listed(names)}, earlier windows do" if names else ""


# ---- where an estimate lies ------------------------------------------------------------------------------------------


def _exchanged(findings: Findings) -> AnomalyDiagnosis | None:
    """Return the one of base dry and viscous friction whose excess is the other's deficit, or None.

    Their sum at the window's mean speed is then nominal. No healthy or failing wheel has much less than nominal
    friction. Where the speed hardly varies, its measurement noise flattens the slope (errors in variables: Fuller 1987,
    section 1.1), and the base absorbs the rest.
    """
    inputs, (dry, viscous) = findings.inputs, findings.anomalies[:2]
    speed_rad_s = inputs.evidence.sums.mean[0] * inputs.wheel.speed_unit_rad_s
    found = None
    for high, lacking, lever in ((dry, viscous, speed_rad_s), (viscous, dry, 1.0 / max(speed_rad_s, 1e-9))):
        top, low_end, high_end = high.nominal_high, lacking.nominal_low, lacking.nominal_high
        if high.estimate is None or lacking.estimate is None or top is None or low_end is None or high_end is None:
            continue
        # Below the range by its whole width: no healthy wheel has that.
        lacks = high.active and lacking.estimate < low_end - (high_end - low_end)
        if lacks and high.estimate - (0.5 * (low_end + high_end) - lacking.estimate) * lever <= top:
            found = high
    return found


def _below(one: AnomalyDiagnosis) -> bool:
    return one.estimate is not None and one.nominal_low is not None and one.estimate < one.nominal_low


def _outside(one: AnomalyDiagnosis, *, adequate: bool) -> bool:
    """Return whether an estimate contradicts that its friction is nominal.

    It does if outside the nominal range by more than its standard deviation. Where the friction model does not fit, the
    standard deviation includes the missing effect, and the range must hold all of estimate ± std.
    """
    if one.estimate is None or one.nominal_low is None or one.nominal_high is None:
        return False
    beyond = max(one.estimate - one.nominal_high, one.nominal_low - one.estimate)
    return beyond > (one.std if adequate else -one.std)
