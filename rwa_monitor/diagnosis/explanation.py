"""Words for an operator: the reason in one sentence, and two or three sentences to act on. They name numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from rwa_monitor.diagnosis.adequacy import Adequacy
from rwa_monitor.diagnosis.window_diagnosis import DRY_UNIT, AnomalyDiagnosis, Verdict
from rwa_monitor.words import counted

# What to look at, by anomaly. Dry friction is contact, viscous friction the lubricant (paper, section III-A).
_ACTION = {
    "dry": "Check the bearing's lubrication; keep the wheel away from zero speed until the cause is understood.",
    "viscous": "Check the lubricant: compare with bearing temperature and age before blaming wear.",
}
_ACTION_SYSTEM = "Check for cage or oil-pocket trouble: compare the size and rate of its jumps with earlier windows."
_ACTION_MODEL = (
    "Run rwa-monitor discrepancy on this window for the name of what is missing; until then what is said of the wheel's"
    " health is worth less. A drift can be the fault itself: do not extend the wheel file while friction moves, compare"
    " with the last healthy windows."
)
_ACTION_MODEL_TOO = (
    "rwa-monitor discrepancy may name what is missing, but what it finds can be the fault itself: do not extend the"
    " wheel file by it before that is ruled out."
)
CHECK_TELEMETRY: Final = "Check the telemetry link and the sensors before the wheel."
BELOW_NOMINAL: Final = ": below nominal, so check units, sign or the wheel file"
ANOTHER_WHEEL: Final = "it is so from the first window on, so is this wheel file of this wheel?"
_ANOTHER_WHEEL_ACTION = (
    "Before acting, see that the wheel file is this wheel's own, learned from it by rwa-monitor identify (run"
    " --wheel-folder takes one for each wheel): a file of another wheel looks like this, and so does a wheel that ailed"
    " before it was monitored."
)
WORTH_NAMING = 0.1  # probability from which another anomaly is named beside the one diagnosed
_NEVER_RESTED = (
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


def reason_anomalous(active: Sequence[AnomalyDiagnosis], shown_before: Sequence[str] = ()) -> str:
    """Return the reason of an anomalous verdict: every anomaly with its numbers, the most severe first.

    `shown_before` names those that earlier windows show and this one alone does not.
    """
    parts = [
        f"{title(anomaly.name)} is {quantity(anomaly.estimate, anomaly.unit)}"
        f" (nominal {span(anomaly.nominal_low, anomaly.nominal_high, anomaly.unit)}, probability of an anomaly"
        f" {percent(anomaly.probability)})"
        for anomaly in sorted(active, key=lambda anomaly: -(anomaly.severity or 0.0))
    ]
    return _sentence("; ".join(parts) + _leaning(shown_before))


def reason_nominal(anomalies: Sequence[AnomalyDiagnosis], shown_before: Sequence[str] = (), lacking: str = "") -> str:
    """Return the reason of a nominal verdict; `shown_before` as for `reason_anomalous`, `lacking` what does not fit."""
    worst = max(anomalies, key=lambda anomaly: anomaly.probability)
    what = f"friction is nominal{lacking}" if lacking else "all friction is nominal"
    return _sentence(
        f"{what}; the most suspect, {title(worst.name)}, is {quantity(worst.estimate, worst.unit)}"
        f" (nominal {span(worst.nominal_low, worst.nominal_high, worst.unit)}, probability of an anomaly"
        f" {percent(worst.probability)}){_leaning(shown_before)}"
    )


def reason_outside(anomaly: AnomalyDiagnosis, lacking: str, *, below: bool) -> str:
    """Return the reason of a verdict kept open by an estimate that may not lie in its range; `lacking` as above."""
    where = "may lie outside its nominal range" if lacking else "lies outside its nominal range"
    return _sentence(
        f"{title(anomaly.name)}, {quantity(anomaly.estimate, anomaly.unit)}, {where}"
        f" ({span(anomaly.nominal_low, anomaly.nominal_high, anomaly.unit)}){lacking}, although it does not look like a"
        f" learned anomaly (probability {percent(anomaly.probability)}){BELOW_NOMINAL if below else ''}"
    )


def reason_exchanged(dry: AnomalyDiagnosis, viscous: AnomalyDiagnosis) -> str:
    """Return the reason of a verdict kept open because base dry and viscous friction stand in for each other."""
    parts = " and ".join(
        f"{title(one.name)} ({quantity(one.estimate, one.unit)}, nominal"
        f" {span(one.nominal_low, one.nominal_high, one.unit)})"
        for one in (dry, viscous)
    )
    return _sentence(f"{parts} cannot be told apart at these speeds: together they are nominal")


def reason_silent(silent: Sequence[str], anomalies: int, lacking: str) -> str:
    """Return the reason of a verdict kept open by what the window does not show, of so many anomalies in all."""
    if len(silent) == anomalies:
        return f"The window shows none of the wheel's coefficients well enough to judge them{lacking}."
    return f"Nothing else is anomalous, but the window does not show {listed(silent)}{lacking}."


def reason_unknown(unknown: Sequence[str], lacking: str) -> str:
    """Return the reason of a verdict kept open by parts whose healthy friction is not given."""
    return f"Nothing else is anomalous, but nothing says how large healthy {listed(unknown)} is{lacking}."


def _leaning(names: Sequence[str]) -> str:
    """Return the end of a reason, on what earlier windows show and this one does not; "" for nothing."""
    return f"; this window alone does not show {listed(names)}, earlier windows do" if names else ""


def listed(names: Sequence[str]) -> str:
    """Return what the anomalies' friction is called, as a list in a sentence."""
    titles = [title(name) for name in names]
    return titles[0] if len(titles) == 1 else f"{', '.join(titles[:-1])} and {titles[-1]}"


def explain(
    verdict: Verdict,
    reason: str,
    anomalies: Sequence[AnomalyDiagnosis],
    *,
    base_known: bool,
    windows_before: int,
    adequacy: Adequacy,
    remedy: str = "",
    another_wheel: bool = False,
) -> str:
    """Return two or three plain sentences an operator can act on.

    Parameters
    ----------
    verdict, reason, anomalies
        Of the diagnosis.
    base_known
        Whether the window itself distinguishes base dry friction from the switching systems'.
    windows_before
        Earlier windows that were used.
    adequacy
        Whether the friction model fits.
    remedy
        What helps an inconclusive verdict where waiting does not; "" where it does.
    another_wheel
        Whether the wheel file may be another wheel's.
    """
    worst = max((a for a in anomalies if a.active), key=lambda anomaly: anomaly.severity or 0.0, default=None)
    if verdict == "anomalous" and worst is not None:
        qualification = _alternatives(anomalies, base_known=base_known) or (
            _severity(worst) if base_known else _NEVER_RESTED
        )
        action = _ACTION.get(worst.name, _ACTION_SYSTEM)
    elif verdict == "nominal":
        qualification = "" if base_known else _NEVER_RESTED
        action = f"No action is needed{_earlier(windows_before)}."
    else:
        qualification = ""
        action = remedy or "Wait for the next window, or give this one more samples, before acting."
    if not adequacy.adequate and not remedy:
        suspect = f", {adequacy.suspected_effect} is suspected" if adequacy.suspected_effect else ""
        qualification = f"The friction model lacks something this wheel has: {adequacy.finding}{suspect}."
        action = f"{action} {_ACTION_MODEL_TOO}" if verdict == "anomalous" else _ACTION_MODEL
    if another_wheel:
        action = f"{_ANOTHER_WHEEL_ACTION} {action}" if verdict == "anomalous" else _ANOTHER_WHEEL_ACTION
    return " ".join(sentence for sentence in (reason, qualification, action) if sentence)


def _alternatives(anomalies: Sequence[AnomalyDiagnosis], *, base_known: bool) -> str:
    """Return a sentence that names what it could be instead, "" where nothing else is likely."""
    alternatives = [anomaly for anomaly in anomalies if not anomaly.active and anomaly.probability > WORTH_NAMING]
    if not alternatives:
        return ""
    names = " or ".join(
        f"{title(alternative.name)} ({percent(alternative.probability)})" for alternative in alternatives
    )
    why = "" if base_known else ", since a switching system never rested in it"
    return f"It may be {names} instead: this window alone cannot fully tell them apart{why}."


def _severity(anomaly: AnomalyDiagnosis) -> str:
    if anomaly.severity is None or anomaly.severity_std is None:
        return ""
    return (
        f"The severity of {anomaly.name} is {anomaly.severity:.2g} ± {anomaly.severity_std:.1g}"
        " (0 at the nominal bound, 1 at the typical learned anomaly)."
    )


def _earlier(windows: int) -> str:
    if windows == 0:
        return "; there is no earlier window to compare with"
    return f"; {counted(windows, 'earlier window')} of this wheel went into this"


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."
