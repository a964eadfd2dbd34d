"""From the evidence of a closed window to its diagnosis: the stages after detection, in order.

evidence → assignment (with estimation inside) → components → features → classification → words

Inside, all values are normalised; the diagnosis is in SI units. It is a function of the evidence, the wheel, the model
and the carried state, of nothing else.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.changepoints.stage_results import REJECTED, Assignment, Components, Estimate, Evidence
from rwa_monitor.diagnosis.adequacy import FITS, Adequacy, ModelErrorUncertainty, check, uncertainty_of
from rwa_monitor.diagnosis.classification import Judgement, classify, unjudged
from rwa_monitor.diagnosis.features import Features, SystemFeatures, features_of, without_prior
from rwa_monitor.diagnosis.findings import (
    DRY_UNIT,
    VISCOUS_UNIT,
    DiagnosisInput,
    Findings,
    anomalies_of,
    changepoints_of,
    scaled,
    value_of,
    viscous_unit,
)
from rwa_monitor.diagnosis.model import Model
from rwa_monitor.diagnosis.verdict import CHECK_TELEMETRY, covered, explain, verdict_of
from rwa_monitor.messages import Anomaly, Diagnosis, Friction, Residuals, Sojourns, Verdict
from rwa_monitor.switching.assignment import assign
from rwa_monitor.switching.carried_state import CarriedState, Tracked, follow, next_systems
from rwa_monitor.switching.components import split
from rwa_monitor.switching.friction_model import slope_prior
from rwa_monitor.wheel.effects.catalogue import viscous_per_K
from rwa_monitor.wheel.effects.drag_laws import SEASON_K
from rwa_monitor.wheel.wheel import Wheel

MIN_USED: Final = 16  # samples below which nothing is estimated at all


class TemperatureUncertainty(NamedTuple):
    """Uncertainty of viscous friction due to the temperature.

    Attributes
    ----------
    share
        Standard deviation, as a share of the viscous friction.
    level
        Standard deviation that this causes in the levels, normalised.
    reason
        Why, as the end of a sentence; "" where it is too small to report.
    """

    share: float = 0.0
    level: float = 0.0
    reason: str = ""

    def widen(self, features: Features) -> Features:
        """Return the features with the standard deviations of viscous friction, and of the levels, widened."""
        if self.share == 0.0:
            return features
        viscous = self.share * max(abs(features.viscous), 1.0)
        if self.level > 0.0:
            of_levels = ModelErrorUncertainty(self.level, viscous * features.viscous_unit, self.level)
            return of_levels.widen(features)
        return features._replace(
            viscous_std=math.hypot(features.viscous_std, viscous), by_path=tuple(map(self.widen, features.by_path))
        )


class Stages(NamedTuple):
    """Results of stages 2 and 3, whether the friction model fits, and the uncertainty due to the temperature.

    `measured` are the features as this window alone measures them; in `features`, the estimate of viscous friction also
    includes earlier windows.
    """

    assignment: Assignment
    estimate: Estimate
    components: Components
    features: Features
    measured: Features
    fits: Adequacy
    of_temperature: TemperatureUncertainty = TemperatureUncertainty()


def diagnose_window(
    evidence: Evidence, wheel: Wheel, model: Model | None, carried: CarriedState, start_ns: int = 0
) -> tuple[Diagnosis, Features, CarriedState]:
    """Diagnose one window.

    Parameters
    ----------
    evidence
        Stage 1: candidates, running sums, noise.
    wheel
        The wheel.
    model
        The learned model; None gives the friction and its parts, with an inconclusive verdict. Where the model does not
        cover a system of this wheel, the friction stated in the wheel file is used.
    carried
        The state after earlier windows; `CarriedState.empty()` for the first.
    start_ns
        Time of the window's first slot.

    Returns
    -------
    tuple[Diagnosis, Features, CarriedState]
        The diagnosis, the features, and the state for the next window. A window with too few samples to estimate
        anything leaves the state as it was.
    """
    inputs = DiagnosisInput(evidence, wheel, model, carried, start_ns=start_ns)
    if evidence.used < MIN_USED:
        return *too_few(inputs), carried
    stages = _run_stages(inputs)
    judgement = _judge(inputs, stages)
    if not all(map(np.array_equal, judgement.configurations, stages.assignment.configurations)):
        # By the learned model, other configurations for the same jumps are likelier than by the wheel's broad laws.
        relabelled = replace(stages.assignment, configurations=judgement.configurations)
        stages = _run_stages(inputs, (relabelled, stages.estimate))
        judgement = _judge(inputs, stages)
    diagnosis = concluded(inputs, stages, judgement, verdict_of)
    known, std = stages.features.base_known, evidence.noise.std
    base_dry, viscous = _tracked(inputs, stages, judgement)
    state = CarriedState(
        windows=carried.windows + 1,
        base_dry=base_dry,
        viscous=viscous,
        noise_std=std if math.isfinite(std) else carried.noise_std,
        probability=judgement.next_prior,
        inadequate=0 if stages.fits.adequate else carried.inadequate + 1,
        fss=next_systems(carried, wheel, stages.assignment, stages.components, learn=known),
    )
    return diagnosis, stages.features, state


def _run_stages(inputs: DiagnosisInput, given: tuple[Assignment, Estimate] | None = None) -> Stages:
    """Run the stages after detection; with an assignment `given`, those after the assignment."""
    evidence, wheel = inputs.evidence, inputs.wheel
    assignment, estimate = given or assign(evidence, wheel, inputs.carried)
    components = split(assignment, estimate, evidence, wheel, inputs.carried)
    features = features_of(components, assignment, wheel)
    measured = features
    if inputs.carried.viscous is not None:
        measured = without_prior(features, slope_prior(wheel, inputs.carried, 0.0))
    fits = check(evidence, estimate, assignment, wheel.fss)
    if not fits.adequate:
        uncertainty = uncertainty_of(evidence, estimate, assignment, components, wheel)
        features, measured = uncertainty.widen(features), uncertainty.widen(measured)
        wide = float(np.hypot(components.viscous_std, uncertainty.viscous))
        components = components._replace(viscous_std=wide)
    of_temperature = temperature_uncertainty(evidence, components, wheel, adequate=fits.adequate)
    features, measured = of_temperature.widen(features), of_temperature.widen(measured)
    return Stages(assignment, estimate, components, features, measured, fits, of_temperature)


# ---- uncertainty of viscous friction, and of the levels, due to the bearing's temperature ----------------------------
# Where the wheel file holds the temperature law, viscous friction is judged at the measured temperature. Where that is
# unknown, or outside the range over which the law was learned, viscous friction is as uncertain as the law makes it
# over the possible temperatures. If the friction model then does not fit, viscous friction may also vary within the
# window, and its change at the window's speed enters the levels.


# Share of a wheel's unknown temperature variation that may occur within a window. A working assumption: of an orbit's
# ±3 K and a year's ±15 K it is a fifth, of an orbit's alone it is all.
WITHIN_WINDOW: Final = 0.5
UNINFORMATIVE_SPREAD: Final = 10.0  # times viscous friction: so uncertain, no window is informative on it
MIN_REPORTED_SHARE: Final = 0.01  # of viscous friction: half of the spread of healthy wheels; less is not reported


def temperature_uncertainty(
    evidence: Evidence, components: Components, wheel: Wheel, *, adequate: bool
) -> TemperatureUncertainty:
    """Return the uncertainty of viscous friction due to the temperature.

    Parameters
    ----------
    evidence, components
        The window, and its friction.
    wheel
        Its temperature law and the range over which that holds, or the spread of its viscous friction.
    adequate
        Whether the friction model fits.
    """
    heat, known = evidence.heat, wheel.temperature
    share, reason = 0.0, ""
    if heat is None:
        # The nominal band includes the spread (`model.with_wider_band`), unless temperature may vary within the window.
        share = (wheel.nominal.viscous_spread or 0.0) if wheel.nominal and not adequate else 0.0
        reason = "its viscous friction varies with a temperature that is not recorded"
    elif heat.unknown < 0.5 and known and not known.low_degC <= heat.mean_degC <= known.high_degC:
        return TemperatureUncertainty(
            UNINFORMATIVE_SPREAD,
            reason=f"the bearing is at {heat.mean_degC:.3g} °C, and its viscous friction was learned from"
            f" {known.low_degC:.3g} °C to {known.high_degC:.3g} °C",
        )
    else:
        error_K = heat.error_K
        reason = f"the bearing's temperature is missing, or stuck, for {100.0 * heat.unknown:.0f} % of the window"
        if not adequate and heat.low_degC == heat.high_degC and not heat.unknown:
            error_K = math.hypot(error_K, SEASON_K)  # what a sensor with a constant reading may miss
            reason = f"the bearing's temperature stands still at {heat.mean_degC:.3g} °C while friction does not"
        share = abs(viscous_per_K(wheel, heat.mean_degC)) * error_K
    if share == 0.0:
        return TemperatureUncertainty()
    level = 0.0
    if not adequate:
        level = WITHIN_WINDOW * share * max(components.viscous, 0.0) * evidence.sums.mean[0]
    return TemperatureUncertainty(share, level, reason if share > MIN_REPORTED_SHARE else "")


# ---- the judgement, and what follows from it -------------------------------------------------------------------------


def _judge(inputs: DiagnosisInput, stages: Stages) -> Judgement:
    names, features = inputs.wheel.anomalies, stages.features
    if inputs.model is None:
        return unjudged(features, names)
    if not covered(inputs):
        # The carried probabilities stay too: the few samples may have another sampling rate, or be of another wheel.
        return unjudged(features, names)._replace(next_prior=dict(inputs.carried.probability))
    window = inputs.wheel.window
    new_share = min(1.0, window.hop_slots / window.samples) if inputs.carried.windows else 1.0
    if not stages.fits.adequate:
        new_share = 0.0  # a missing effect repeats in every window: it must not accumulate to certainty
    judgement = classify(stages.measured, inputs.models, names, inputs.model, inputs.carried, new_share)
    seen = judgement.features._replace(viscous=features.viscous, viscous_std=features.viscous_std)
    return judgement._replace(features=seen)


def _tracked(inputs: DiagnosisInput, stages: Stages, judgement: Judgement) -> tuple[Tracked | None, Tracked | None]:
    """Return the tracked base dry and viscous friction after the window, normalised.

    A window that the friction model does not fit updates neither: the missing effect biases its estimates. Nor does one
    with less than half of its samples. Then only the uncertainty grows.
    """
    base, viscous = inputs.carried.base_dry, inputs.carried.viscous
    if not (stages.fits.adequate and covered(inputs)):
        return base and base.drifted(), viscous and viscous.drifted()
    unit = stages.measured.viscous_unit
    if inputs.model is not None:
        base, viscous = judgement.tracked
        return base, None if viscous is None else viscous.scaled(unit)
    seen = stages.measured
    return (
        follow(base, seen.base_dry, seen.base_dry_std, known=seen.base_known),
        follow(viscous, seen.viscous * unit, seen.viscous_std * unit, known=True),
    )


def concluded(
    inputs: DiagnosisInput,
    stages: Stages,
    judgement: Judgement,
    rule: Callable[[Findings], tuple[Verdict, str]],
) -> Diagnosis:
    """Return the diagnosis of a window.

    Parameters
    ----------
    inputs, stages, judgement
        The inputs, the results of the stages, and the judgement on the features.
    rule
        Gives the verdict and its reason.
    """
    wheel, fits, features = inputs.wheel, stages.fits, judgement.features
    torque, viscous, noise = wheel.torque_unit_Nm, viscous_unit(wheel), inputs.evidence.noise.std
    findings = Findings(
        inputs,
        anomalies_of(inputs, judgement),
        stages.features.base_known,
        fits,
        unnamed_jumps=not wheel.fss and bool((stages.assignment.system != REJECTED).any()),
        temperature_uncertainty=stages.of_temperature.reason,
    )
    verdict, reason = rule(findings)
    return Diagnosis(
        verdict=verdict,
        reason=reason,
        anomalies={one.name: Anomaly.model_validate(one, from_attributes=True) for one in findings.anomalies},
        friction=Friction(
            base_dry=value_of(features.base_dry, features.base_dry_std, torque, DRY_UNIT),
            viscous=value_of(stages.components.viscous, stages.components.viscous_std, viscous, VISCOUS_UNIT),
            fss={
                system.name: Sojourns(
                    configuration=system.configuration.tolist(),
                    friction_Nm=(system.friction * torque).tolist(),
                    start_index=starts.tolist(),
                )
                for system, starts in zip(features.systems, stages.assignment.starts, strict=True)
            },
        ),
        changepoints=changepoints_of(stages.assignment, wheel, inputs.start_ns),
        fit=Residuals(
            rmse_Nm=scaled(stages.estimate.rmse, torque),
            excess_rmse_Nm=scaled(stages.estimate.rmse - noise, torque),
            noise_std_Nm=scaled(noise, torque),
        ),
        model_adequate=fits.adequate,
        suspected_effect=fits.suspected_effect,
        explanation=explain(findings, verdict, reason),
        **inputs.stated(),
    )


def too_few(inputs: DiagnosisInput) -> tuple[Diagnosis, Features]:
    """Return diagnosis and features of a window with less than `MIN_USED` samples, too few to estimate anything."""
    evidence, whole, unknown = inputs.evidence, inputs.wheel.window.samples, (math.nan,) * 4
    slots, values = np.zeros(0, dtype=np.int64), np.zeros(0)
    systems = tuple(SystemFeatures(one.name, slots, values, values, rests=True) for one in inputs.wheel.fss)
    features, none = Features(*unknown, systems), (slots,) * len(systems)
    stages = Stages(
        Assignment(slots, slots, slots, values, values, values, none, none, 0.0, 0, pruned=False),
        Estimate(slots, values, values, values, *unknown[:3]),
        Components(*unknown, (), ()),
        features,
        features,
        FITS,
    )
    reason = f"Only {evidence.used} of the window's {evidence.slots} slots hold a usable sample."
    advice = CHECK_TELEMETRY
    if evidence.used == evidence.slots:
        reason = f"The window holds {evidence.used} samples: too few to measure friction, a whole one has {whole}."
        advice = "Give it a longer recording."
    judgement = unjudged(features, inputs.wheel.anomalies)
    diagnosis = concluded(inputs, stages, judgement, lambda _: ("inconclusive", reason))
    fit = Residuals(rmse_Nm=None, excess_rmse_Nm=None, noise_std_Nm=None)
    return diagnosis.model_copy(update={"fit": fit, "explanation": f"{reason} {advice}"}), features
