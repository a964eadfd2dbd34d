"""Words for an operator: the reason in one sentence, and two or three sentences to act on. They name numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from rwa_monitor.diagnosis.window_diagnosis import DRY_UNIT, AnomalyDiagnosis, Findings, Verdict
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
WORTH_NAMING = 0.1  # probability from which another anomaly is named beside the one diagnosed
_NEVER_RESTED = (  # the words are those of the reference recordings
    "A switching system never rested in this window, so base dry friction and its own were told apart by learned"
    " ranges and earlier windows only."
)


def quantity(value: float | None, unit: str) -> str:
    """Write a value with three significant digits; torques with a prefix, as in `1.62 mN m`."""
    if value is None or not math.isfinite(value):
        return "unknown"
    if unit != DRY_UNIT or value == 0:
        return f"{value:.3g} {unit}"
    for scale, prefix in ((1.0, ""), (1e3, "m"), (1e6, "µ")):
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


def explain(
    findings: Findings,
    verdict: Verdict,
    reason: str,
    *,
    windows_before: int,
    remedy: str = "",
) -> str:
    """Return two or three plain sentences an operator can act on.

    Parameters
    ----------
    findings, verdict, reason
        Of the diagnosis.
    windows_before
        Earlier windows that were used.
    remedy
        What helps an inconclusive verdict where waiting does not; "" where it does.
    """
    worst = max((one for one in findings.anomalies if one.active), key=lambda one: one.severity or 0.0, default=None)
    qualification = ""
    if verdict == "anomalous" and worst is not None:
        qualification = _alternatives(findings) or (_severity(worst) if findings.base_known else _NEVER_RESTED)
        action = _ACTION.get(worst.name, _ACTION_SYSTEM)
    elif verdict == "nominal":
        qualification = "" if findings.base_known else _NEVER_RESTED
        earlier = "there is no earlier window to compare with"
        if windows_before:
            earlier = f"{counted(windows_before, 'earlier window')} of this wheel went into this"
        action = f"No action is needed; {earlier}."
    else:
        action = remedy or "Wait for the next window, or give this one more samples, before acting."
    fits = findings.fits
    if not fits.adequate and not remedy:
        suspect = f", {fits.suspected_effect} is suspected" if fits.suspected_effect else ""
        qualification = f"The friction model lacks something this wheel has: {fits.finding}{suspect}."
        action = f"{action} {_ACTION_MODEL_TOO}" if verdict == "anomalous" else _ACTION_MODEL
    return " ".join(sentence for sentence in (reason, qualification, action) if sentence)


def _alternatives(findings: Findings) -> str:
    """Return a sentence that names what it could be instead, "" where nothing else is likely."""
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
