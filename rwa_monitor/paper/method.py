"""The paper's method on a window: detection, estimation, assignment, classification, and what it diagnoses.

The paper ends at θ̂, the anomalies of a window. What a diagnosis holds beside it (whether the friction model fits,
explanations) is that of the default method. What earlier windows show is not used, and passes through unchanged.
"""

from __future__ import annotations

from dataclasses import replace

from rwa_monitor.changepoints.stage_results import Assignment, Components, Estimate, Evidence
from rwa_monitor.diagnosis import adequacy, explanation
from rwa_monitor.diagnosis.classification import unjudged
from rwa_monitor.diagnosis.features import features_of
from rwa_monitor.diagnosis.model import Model, models_for
from rwa_monitor.diagnosis.verdict import covered, lacking_of, nothing_to_judge, remedy_of, without_anomaly
from rwa_monitor.diagnosis.window import MIN_USED, Stages, anomalies_of, assembled, shown_of, too_few
from rwa_monitor.diagnosis.window_diagnosis import DiagnosisInput, Verdict, WindowDiagnosis
from rwa_monitor.paper.assignment import STATE_CAP, assign, split
from rwa_monitor.paper.classification import classify
from rwa_monitor.paper.detection import Signal, detect
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.wheel import Wheel


def split_friction(
    evidence: Evidence, wheel: Wheel, *, limit: int = STATE_CAP, hard: bool = False
) -> tuple[Assignment, Estimate, Components]:
    """Split the friction of a window into its parts: sections IV-A to IV-C.

    Parameters
    ----------
    evidence
        The closed window: its samples and its noise are used, its candidates are not.
    wheel
        The wheel.
    limit, hard
        As for `assignment.assign`.
    """
    signal, noise = Signal.of(evidence), evidence.noise
    assignment, levels = assign(signal, detect(signal, noise, wheel), noise, wheel, limit=limit, hard=hard)
    return assignment, levels, split(assignment, levels, wheel)


def diagnose_window(
    evidence: Evidence, wheel: Wheel, model: Model | None, carried: CarriedState
) -> tuple[WindowDiagnosis, CarriedState]:
    """Diagnose one window by the paper's method.

    Parameters
    ----------
    evidence, wheel, model, carried
        As for `diagnosis.window.diagnose_window`.

    Returns
    -------
    tuple[WindowDiagnosis, CarriedState]
        The diagnosis, and the carried state as it was given.
    """
    inputs = DiagnosisInput(evidence, wheel, model, carried)
    models = models_for(wheel, model)
    if evidence.used < MIN_USED:
        return replace(too_few(inputs, models), method="paper"), carried
    assignment, levels, components = split_friction(evidence, wheel)
    features = features_of(components, assignment, wheel)
    fits = adequacy.check(evidence, levels, assignment, wheel.fss)
    if model is not None and covered(inputs):
        judgement = classify(features, models, wheel.anomalies)
    else:
        judgement = unjudged(features, wheel.anomalies)
    anomalies = anomalies_of(inputs, models, judgement)
    shown = shown_of(inputs, features, assignment)
    active = [anomaly for anomaly in anomalies if anomaly.active]
    verdict: Verdict
    if nothing := nothing_to_judge(inputs):
        verdict, reason = "inconclusive", nothing
    elif active:  # θ̂ ≠ 0
        verdict, reason = "anomalous", explanation.reason_anomalous(active)
    else:
        verdict, reason = without_anomaly(inputs, judgement.anomalies, anomalies, lacking_of(fits, shown))
    text = explanation.explain(
        verdict,
        reason,
        anomalies,
        base_known=features.base_known,
        windows_before=0,
        adequacy=fits,
        remedy=remedy_of(inputs, anomalies, shown, adequate=fits.adequate) if verdict == "inconclusive" else "",
    )
    stages = Stages(assignment, levels, components, features, features, fits)
    return replace(assembled(inputs, stages, features, anomalies, (verdict, reason, text)), method="paper"), carried
