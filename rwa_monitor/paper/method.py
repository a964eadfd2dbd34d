"""The paper's method on a window: detection, estimation, assignment, classification, diagnosis.

The paper ends at θ̂, the anomalies of a window. The rest of a diagnosis (whether the friction model fits, explanations)
is that of the default method. The carried state of earlier windows is not used, and passes through unchanged.
"""

from rwa_monitor.changepoints.stage_results import Assignment, Components, Estimate, Evidence
from rwa_monitor.diagnosis.adequacy import check
from rwa_monitor.diagnosis.classification import unjudged
from rwa_monitor.diagnosis.features import Features, features_of
from rwa_monitor.diagnosis.findings import DiagnosisInput, Findings
from rwa_monitor.diagnosis.model import Model
from rwa_monitor.diagnosis.verdict import covered, nothing_to_judge, reason_anomalous, without_anomaly
from rwa_monitor.diagnosis.window import MIN_USED, Stages, concluded, too_few
from rwa_monitor.messages import Diagnosis, Verdict
from rwa_monitor.paper.assignment import assign, split
from rwa_monitor.paper.classification import classify
from rwa_monitor.paper.detection import Signal, detect
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.wheel import Wheel


def split_friction(evidence: Evidence, wheel: Wheel, *, hard: bool = False) -> tuple[Assignment, Estimate, Components]:
    """Split the friction of a window into its parts: sections IV-A to IV-C.

    Parameters
    ----------
    evidence
        The closed window: its samples and its noise are used, its candidates are not.
    wheel
        The wheel.
    hard
        As for `assignment.assign`.
    """
    signal, noise = Signal.of(evidence), evidence.noise
    assignment, levels = assign(signal, detect(signal, noise, wheel), noise, wheel, hard=hard)
    return assignment, levels, split(assignment, levels, wheel)


def diagnose_window(
    evidence: Evidence, wheel: Wheel, model: Model | None, carried: CarriedState, start_ns: int = 0
) -> tuple[Diagnosis, Features, CarriedState]:
    """Diagnose one window by the paper's method.

    Parameters
    ----------
    evidence, wheel, model, carried
        As for `diagnosis.window.diagnose_window`.

    Returns
    -------
    tuple[Diagnosis, Features, CarriedState]
        The diagnosis, and the carried state as it was given.
    """
    inputs = DiagnosisInput(evidence, wheel, model, carried, "paper", start_ns)
    if evidence.used < MIN_USED:
        return *too_few(inputs), carried
    assignment, levels, components = split_friction(evidence, wheel)
    features = features_of(components, assignment, wheel)
    fits = check(evidence, levels, assignment, wheel.fss)
    if model is not None and covered(inputs):
        judgement = classify(features, inputs.models, wheel.anomalies)
    else:
        judgement = unjudged(features, wheel.anomalies)
    stages = Stages(assignment, levels, components, features, features, fits)
    return concluded(inputs, stages, judgement, verdict_of), features, carried


def verdict_of(findings: Findings) -> tuple[Verdict, str]:
    """Return the verdict and its reason: anomalous where θ̂ ≠ 0."""
    nothing = nothing_to_judge(findings.inputs)
    active = [one for one in findings.anomalies if one.active]
    if nothing or not active:
        return ("inconclusive", nothing) if nothing else without_anomaly(findings)
    return "anomalous", reason_anomalous(active)
