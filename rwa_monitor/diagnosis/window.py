"""From the evidence of a closed window to its diagnosis: the stages after detection, in order.

evidence → assignment (with estimation inside) → components → features → classification → words

Everything inside is normalised; what leaves is in SI units. A diagnosis is a function of the evidence, the wheel, the
model and the carried state, of nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rwa_monitor.changepoints.stage_results import (
    REJECTED,
    Assignment,
    Components,
    Estimate,
    Evidence,
)
from rwa_monitor.diagnosis import adequacy, explanation
from rwa_monitor.diagnosis.adequacy import Adequacy
from rwa_monitor.diagnosis.classification import Judgement, classify, unjudged
from rwa_monitor.diagnosis.features import (
    Features,
    SystemFeatures,
    features_of,
    normalised_nominal_viscous,
    without_prior,
)
from rwa_monitor.diagnosis.model import AnomalyModel, Model, models_for
from rwa_monitor.diagnosis.model_error_uncertainty import uncertainty_of
from rwa_monitor.diagnosis.verdict import Shown, covered, from_another_wheel, remedy_of, verdict_of
from rwa_monitor.diagnosis.window_diagnosis import (
    DRY_UNIT,
    VISCOUS_UNIT,
    AnomalyDiagnosis,
    DiagnosisInput,
    Fit,
    SystemFriction,
    Value,
    Verdict,
    WindowDiagnosis,
    anomaly_of,
    changepoints_of,
    scaled,
    value_of,
    viscous_unit,
)
from rwa_monitor.samples import IntArray
from rwa_monitor.switching.assignment import assign
from rwa_monitor.switching.carried_state import CarriedState, Tracked, follow, next_state
from rwa_monitor.switching.components import split
from rwa_monitor.switching.friction_model import slope_prior
from rwa_monitor.wheel.wheel import Wheel

MIN_USED: Final = 16  # samples below which nothing is estimated at all


@dataclass(frozen=True, slots=True)
class Stages:
    """Results of stages 2 and 3, and whether the friction model fits.

    `measured` are the features as this window alone measures them; in `features`, viscous friction also holds what
    earlier windows show of it.
    """

    assignment: Assignment
    estimate: Estimate
    components: Components
    features: Features
    measured: Features
    fits: Adequacy


def diagnose_window(
    evidence: Evidence,
    wheel: Wheel,
    model: Model | None,
    carried: CarriedState,
    *,
    with_model_error: bool = True,
) -> tuple[WindowDiagnosis, CarriedState]:
    """Diagnose one window.

    Parameters
    ----------
    evidence
        Stage 1: candidates, running sums, noise.
    wheel
        The wheel.
    model
        What was learned; None gives the friction and its parts, with an inconclusive verdict. What the model does not
        hold of this wheel is taken from the wheel file where it is stated (friction of the configurations).
    carried
        What earlier windows showed; `CarriedState.empty()` for the first.
    with_model_error
        False keeps the standard deviations as they would be if no effect was missing where the friction model does not
        fit: to measure what the uncertainty of the model changes.

    Returns
    -------
    tuple[WindowDiagnosis, CarriedState]
        The diagnosis, and the state for the next window. A window with too few samples to estimate anything leaves the
        state as it was.
    """
    inputs = DiagnosisInput(evidence, wheel, model, carried, with_model_error)
    models = models_for(wheel, model)
    if evidence.used < MIN_USED:
        return too_few(inputs, models), carried
    stages = _run_stages(inputs)
    judgement = _judge(inputs, models, stages)
    if _differ(judgement.configurations, stages.assignment.configurations):
        # What was learned makes another interpretation of the same jumps likelier than the wheel's broad laws do.
        relabelled = replace(stages.assignment, configurations=judgement.configurations)
        stages = _run_stages(inputs, (relabelled, stages.estimate))
        judgement = _judge(inputs, models, stages)
    diagnosis = _diagnosis(inputs, models, stages, judgement)
    state = next_state(
        carried,
        wheel,
        assignment=stages.assignment,
        components=stages.components,
        tracked=_tracked(inputs, stages, judgement),
        noise_std=evidence.noise.std,
        probability=judgement.to_carry if model is not None else {},
        base_known=stages.features.base_known,
        adequate=stages.fits.adequate,
    )
    return diagnosis, state


def _differ(first: Sequence[IntArray], second: Sequence[IntArray]) -> bool:
    return not all(np.array_equal(one, other) for one, other in zip(first, second, strict=True))


def _run_stages(inputs: DiagnosisInput, given: tuple[Assignment, Estimate] | None = None) -> Stages:
    """Run the stages after detection; with an assignment `given`, those after the assignment."""
    evidence, wheel = inputs.evidence, inputs.wheel
    assignment, estimate = given or assign(evidence, wheel, inputs.carried)
    components = split(assignment, estimate, evidence, wheel, inputs.carried)
    features = features_of(components, assignment, wheel)
    measured = features
    if inputs.carried.viscous is not None:
        measured = without_prior(features, slope_prior(wheel, inputs.carried, 0.0), normalised_nominal_viscous(wheel))
    fits = adequacy.check(evidence, estimate, assignment, wheel.fss)
    if inputs.with_model_error and not fits.adequate:
        uncertainty, unit = (
            uncertainty_of(evidence, estimate, assignment, components, wheel),
            normalised_nominal_viscous(wheel),
        )
        features, measured = uncertainty.widen_features(features, unit), uncertainty.widen_features(measured, unit)
        components = uncertainty.widen(components)
    return Stages(assignment, estimate, components, features, measured, fits)


def _judge(inputs: DiagnosisInput, models: Sequence[AnomalyModel | None], stages: Stages) -> Judgement:
    names, features = inputs.wheel.anomalies, stages.features
    if inputs.model is None:
        return unjudged(features, names)
    if not covered(inputs):
        # What is carried stays as it is, too: the few samples there are may be of another pace, or of another wheel.
        return replace(unjudged(features, names), to_carry=dict(inputs.carried.probability))
    window = inputs.wheel.window
    new_share = min(1.0, window.hop_slots / window.samples) if inputs.carried.windows else 1.0
    if not stages.fits.adequate:
        new_share = 0.0  # what is missing shows alike in every window: it must not add up to certainty
    viscous_unit = normalised_nominal_viscous(inputs.wheel)
    judgement = classify(stages.measured, models, names, inputs.model, inputs.carried, new_share, viscous_unit)
    seen = replace(judgement.features, viscous=features.viscous, viscous_std=features.viscous_std)
    return replace(judgement, features=seen)


def _tracked(inputs: DiagnosisInput, stages: Stages, judgement: Judgement) -> tuple[Tracked | None, Tracked | None]:
    """Return what is known of base dry and viscous friction after the window, normalised.

    A window that the friction model does not fit moves nothing: what is missing in it is in its estimates too. Nor does
    one of which most is missing.
    """
    base, viscous = inputs.carried.base_dry, inputs.carried.viscous
    if not (stages.fits.adequate and covered(inputs)):
        return base and base.drifted(), viscous and viscous.drifted()
    unit = normalised_nominal_viscous(inputs.wheel)
    if inputs.model is not None:
        base, viscous = judgement.tracked
        return base, None if viscous is None else viscous.scaled(unit)
    seen = stages.measured
    return (
        follow(base, seen.base_dry, seen.base_dry_std, known=seen.base_known),
        follow(viscous, seen.viscous * unit, seen.viscous_std * unit, known=True),
    )


def shown_of(inputs: DiagnosisInput, features: Features, assignment: Assignment) -> Shown:
    """Return what a verdict asks beside the judgement."""
    wheel = inputs.wheel
    nominal = wheel.nominal.viscous_Nm_s_rad if wheel.nominal else 0.0
    deviations = (
        features.base_dry_std * wheel.torque_unit_Nm,
        features.viscous_std * (nominal if nominal > 0 else viscous_unit(wheel)),
        *(system.highest()[2] * wheel.torque_unit_Nm for system in features.systems),
    )
    base, slope = inputs.carried.base_dry, inputs.carried.viscous
    whole = inputs.evidence.sums.between(np.zeros(1, dtype=np.int64), np.array([inputs.evidence.slots]))
    return Shown(
        unmoved=(False, False, *(system.configuration.size < 2 for system in features.systems)),
        deviations=tuple(std if math.isfinite(std) else 0.0 for std in deviations),
        unnamed_jumps=not wheel.fss and bool((assignment.system != REJECTED).any()),
        mean_speed_rad_s=float(whole.x[0] / whole.n[0]) * wheel.speed_unit_rad_s,
        before=(
            base.mean * wheel.torque_unit_Nm if base else math.nan,
            slope.mean * viscous_unit(wheel) if slope else math.nan,
        ),
    )


def _diagnosis(
    inputs: DiagnosisInput,
    models: Sequence[AnomalyModel | None],
    stages: Stages,
    judgement: Judgement,
) -> WindowDiagnosis:
    anomalies = anomalies_of(inputs, models, judgement)
    shown = shown_of(inputs, judgement.features, stages.assignment)
    verdict, reason = verdict_of(inputs, judgement.anomalies, anomalies, stages.fits, shown)
    another_wheel = from_another_wheel(inputs, verdict, anomalies, shown)
    if another_wheel:
        reason = f"{reason.removesuffix('.')}; {explanation.ANOTHER_WHEEL}"
    text = explanation.explain(
        verdict,
        reason,
        anomalies,
        base_known=stages.features.base_known,
        windows_before=inputs.carried.windows,
        adequacy=stages.fits,
        remedy=remedy_of(inputs, anomalies, shown, adequate=stages.fits.adequate) if verdict == "inconclusive" else "",
        another_wheel=another_wheel,
    )
    return assembled(inputs, stages, judgement.features, anomalies, (verdict, reason, text))


def anomalies_of(
    inputs: DiagnosisInput, models: Sequence[AnomalyModel | None], judgement: Judgement
) -> tuple[AnomalyDiagnosis, ...]:
    """Return the entry of each anomaly in the diagnosis, from the judgement on it and what was learned of it."""
    return tuple(
        anomaly_of(inputs.wheel, judged, learned, judgement.features, a)
        for a, (judged, learned) in enumerate(zip(judgement.anomalies, models, strict=True))
    )


def assembled(
    inputs: DiagnosisInput,
    stages: Stages,
    features: Features,
    anomalies: tuple[AnomalyDiagnosis, ...],
    verdict: tuple[Verdict, str, str],
) -> WindowDiagnosis:
    """Return the diagnosis of a window.

    Parameters
    ----------
    inputs, stages
        What it is a function of, and the results of its stages.
    features
        The features as judged.
    anomalies, verdict
        Its entries; the verdict with reason and explanation.
    """
    wheel, fits = inputs.wheel, stages.fits
    torque, viscous = wheel.torque_unit_Nm, viscous_unit(wheel)
    return WindowDiagnosis(
        verdict=verdict[0],
        reason=verdict[1],
        anomalies=anomalies,
        base_dry=value_of(features.base_dry, features.base_dry_std, torque, DRY_UNIT),
        viscous=value_of(stages.components.viscous, stages.components.viscous_std, viscous, VISCOUS_UNIT),
        fss=tuple(
            SystemFriction(
                system.name,
                tuple(system.configuration.tolist()),
                tuple((system.friction * torque).tolist()),
                tuple(starts.tolist()),
            )
            for system, starts in zip(features.systems, stages.assignment.starts, strict=True)
        ),
        changepoints=changepoints_of(stages.assignment, wheel),
        fit=Fit(
            scaled(stages.estimate.rmse, torque),
            scaled(stages.estimate.excess_rmse, torque),
            scaled(inputs.evidence.noise.std, torque),
        ),
        model_adequate=fits.adequate,
        suspected_effect=fits.suspected_effect,
        explanation=verdict[2],
        features=stages.features,
        **inputs.provenance(),
    )


def too_few(inputs: DiagnosisInput, models: Sequence[AnomalyModel | None]) -> WindowDiagnosis:
    """Return the diagnosis of a window with less than `MIN_USED` samples: too few to estimate anything."""
    systems = inputs.wheel.fss
    no_sojourns = SystemFeatures("", np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0), rests=True)
    features = Features(math.nan, math.nan, math.nan, math.nan, (no_sojourns,) * len(systems))
    judgement = unjudged(features, inputs.wheel.anomalies)
    reason = f"Only {inputs.evidence.used} of the window's {inputs.evidence.slots} slots hold a usable sample."
    advice = explanation.CHECK_TELEMETRY
    if inputs.evidence.used == inputs.evidence.slots:
        whole = inputs.wheel.window.samples
        reason = (
            f"The window holds {inputs.evidence.used} samples: too few to measure friction, a whole one has {whole}."
        )
        advice = "Give it a longer recording."
    return WindowDiagnosis(
        verdict="inconclusive",
        reason=reason,
        anomalies=anomalies_of(inputs, models, judgement),
        base_dry=Value(None, None, DRY_UNIT),
        viscous=Value(None, None, VISCOUS_UNIT),
        fss=tuple(SystemFriction(system.name, (), (), ()) for system in systems),
        changepoints=(),
        fit=Fit(None, None, None),
        model_adequate=True,
        suspected_effect=None,
        explanation=f"{reason} {advice}",
        features=features,
        **inputs.provenance(),
    )
