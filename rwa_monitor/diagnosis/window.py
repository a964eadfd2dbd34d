"""From the evidence of a closed window to its diagnosis: the stages after detection, in order.

evidence → assignment (with estimation inside) → components → features → classification → words

Everything inside is normalised; what leaves is in SI units. A diagnosis is a function of the evidence, the wheel, the
model and the carried state, of nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from rwa_monitor.diagnosis import adequacy, explanation
from rwa_monitor.diagnosis.adequacy import Adequacy
from rwa_monitor.diagnosis.assignment import assign
from rwa_monitor.diagnosis.classification import Judged, Judgement, classify, classify_as_paper, unjudged
from rwa_monitor.diagnosis.components import split
from rwa_monitor.diagnosis.doubt import doubt_of
from rwa_monitor.diagnosis.features import (
    Features,
    SystemFeatures,
    features_of,
    normalised_nominal_viscous,
    without_prior,
)
from rwa_monitor.diagnosis.friction_priors import slope_prior
from rwa_monitor.diagnosis.model import AnomalyModel, Levels, Model, models_for
from rwa_monitor.diagnosis.paper_assignment import assign_as_paper, split_as_paper
from rwa_monitor.diagnosis.results import (
    REJECTED,
    UNATTRIBUTED,
    Assignment,
    Components,
    Estimate,
    Evidence,
    Method,
)
from rwa_monitor.diagnosis.state import CarriedState, Tracked, follow, next_state
from rwa_monitor.diagnosis.window_diagnosis import (
    DRY_UNIT,
    VISCOUS_UNIT,
    AnomalyDiagnosis,
    Changepoint,
    Fit,
    SystemFriction,
    Value,
    Verdict,
    WindowDiagnosis,
)
from rwa_monitor.physics.wheel import Wheel
from rwa_monitor.samples import IntArray

MIN_COVERAGE: Final = 0.5  # share of the slots that must be used; below, the window says little about what it missed
MIN_SHARE: Final = 0.1  # of a whole window's samples: with fewer, at the end of a file, it is called nominal by no rule
MIN_USED: Final = 16  # samples below which nothing is estimated at all


@dataclass(frozen=True, slots=True)
class _Case:
    """What a diagnosis is a function of."""

    evidence: Evidence
    wheel: Wheel
    model: Model | None
    carried: CarriedState
    method: Method
    doubting: bool

    def provenance(self) -> dict[str, Any]:
        """Return the fields of the diagnosis that say what it was made from."""
        return {
            "slots": self.evidence.slots,
            "good": self.evidence.good,
            "used": self.evidence.used,
            "coverage": self.evidence.good / self.evidence.slots if self.evidence.slots else 0.0,
            "method": self.method,
            "model_sha256": self.model.sha256() if self.model else "",
            "wheel_sha256": self.wheel.sha256(),
            "prior_sha256": self.carried.sha256(),
        }


@dataclass(frozen=True, slots=True)
class _Stages:
    """Results of stages 2 and 3, and whether the friction model fits.

    `measured` are the features as this window alone measures them; in `features`, viscous friction also holds what
    earlier windows tell of it.
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
    method: Method = "joint",
    *,
    doubting: bool = True,
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
        know about this wheel is taken from the wheel file where it says it (friction of the configurations).
    carried
        What earlier windows tell; `CarriedState.empty()` for the first. The method `paper` ignores it.
    method
        joint or paper.
    doubting
        False keeps the standard deviations as they would be if no effect was missing where the friction model does not
        fit: to measure what the doubt changes.

    Returns
    -------
    tuple[WindowDiagnosis, CarriedState]
        The diagnosis, and the state for the next window. A window with too few samples to estimate anything leaves the
        state as it was.
    """
    case = _Case(evidence, wheel, model, carried, method, doubting)
    models = models_for(wheel, model)
    if evidence.used < MIN_USED:
        return _too_few(case, models), carried
    stages = _run_stages(case)
    judgement = _judge(case, models, stages)
    if _differ(judgement.configurations, stages.assignment.configurations):
        # What was learned makes another reading of the same jumps likelier than the wheel's broad laws do.
        told = replace(stages.assignment, configurations=judgement.configurations)
        stages = _run_stages(case, (told, stages.estimate))
        judgement = _judge(case, models, stages)
    diagnosis = _diagnosis(case, models, stages, judgement)
    state = next_state(
        carried,
        wheel,
        assignment=stages.assignment,
        components=stages.components,
        tracked=_tracked(case, stages, judgement),
        noise_std=evidence.noise.std,
        probability=judgement.to_carry if model is not None else {},
        base_known=stages.features.base_known,
        adequate=stages.fits.adequate,
    )
    return diagnosis, state


def _differ(first: Sequence[IntArray], second: Sequence[IntArray]) -> bool:
    return not all(np.array_equal(one, other) for one, other in zip(first, second, strict=True))


def _run_stages(case: _Case, given: tuple[Assignment, Estimate] | None = None) -> _Stages:
    """Run the stages after detection; with an assignment `given`, those after the assignment."""
    evidence, wheel = case.evidence, case.wheel
    if case.method == "paper":
        assignment, estimate = assign_as_paper(evidence, wheel)
        components = split_as_paper(assignment, estimate, evidence, wheel)
    else:
        assignment, estimate = given or assign(evidence, wheel, case.carried)
        components = split(assignment, estimate, evidence, wheel, case.carried)
    features = features_of(components, assignment, wheel)
    measured = features
    if case.method == "joint" and case.carried.viscous is not None:
        measured = without_prior(features, slope_prior(wheel, case.carried, 0.0), normalised_nominal_viscous(wheel))
    fits = adequacy.check(evidence, estimate, assignment, wheel.fss)
    if case.method == "joint" and case.doubting and not fits.adequate:
        doubt, unit = doubt_of(evidence, estimate, assignment, components, wheel), normalised_nominal_viscous(wheel)
        features, measured = doubt.widen_features(features, unit), doubt.widen_features(measured, unit)
        components = doubt.widen(components)
    return _Stages(assignment, estimate, components, features, measured, fits)


def _judge(case: _Case, models: Sequence[AnomalyModel | None], stages: _Stages) -> Judgement:
    names, features = case.wheel.anomalies, stages.features
    if case.model is None:
        return unjudged(features, names)
    if case.method == "paper":
        return classify_as_paper(features, models, names)
    window = case.wheel.window
    new_share = min(1.0, window.hop_slots / window.samples) if case.carried.windows else 1.0
    if not stages.fits.adequate:
        new_share = 0.0  # what is missing says the same in every window: it must not add up to certainty
    viscous_unit = normalised_nominal_viscous(case.wheel)
    judgement = classify(stages.measured, models, names, case.model, case.carried, new_share, viscous_unit)
    seen = replace(judgement.features, viscous=features.viscous, viscous_std=features.viscous_std)
    return replace(judgement, features=seen)


def _tracked(case: _Case, stages: _Stages, judgement: Judgement) -> tuple[Tracked | None, Tracked | None]:
    """Return what is known of base dry and viscous friction after the window, normalised.

    A window that the friction model does not fit moves nothing: what is missing in it is in its estimates too.
    """
    base, viscous = case.carried.base_dry, case.carried.viscous
    if not stages.fits.adequate:
        return base and base.drifted(), viscous and viscous.drifted()
    unit = normalised_nominal_viscous(case.wheel)
    if case.model is not None and case.method == "joint":
        base, viscous = judgement.tracked
        return base, None if viscous is None else viscous.scaled(unit)
    seen = stages.measured
    return (
        follow(base, seen.base_dry, seen.base_dry_std, known=seen.base_known),
        follow(viscous, seen.viscous * unit, seen.viscous_std * unit, known=True),
    )


@dataclass(frozen=True, slots=True)
class _Shown:
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
    """

    unmoved: tuple[bool, ...]
    deviations: tuple[float, ...]
    unnamed_jumps: bool
    mean_speed_rad_s: float


# ---- the verdict -----------------------------------------------------------------------------------------------------


def _verdict(
    case: _Case,
    judged: Sequence[Judged],
    anomalies: Sequence[AnomalyDiagnosis],
    fits: Adequacy,
    shown: _Shown,
) -> tuple[Verdict, str]:
    """Return the verdict and its reason. A found anomaly stands; what keeps a window from being nominal comes after."""
    nothing = _nothing_to_judge(case)
    if nothing or case.model is None:
        return "inconclusive", nothing
    low, high = case.model.undecided if case.method == "joint" else (0.5, 0.5)
    leaning = [entry.name for entry in judged if entry.leans]
    # Where the friction model lacks something, only what the window tells for sure counts as found: what is missing
    # leaves base dry friction in doubt by its own size, and half of such a doubt lies above any nominal range.
    # And a system that made no jump is not told from the base, or shows nothing at all.
    open_to_doubt = [
        not (entry.telling or fits.adequate) or jumpless for entry, jumpless in zip(judged, shown.unmoved, strict=True)
    ]
    certain = [
        anomaly
        for anomaly, entry, doubtful in zip(anomalies, judged, open_to_doubt, strict=True)
        if entry.active and entry.probability >= high and not doubtful
    ]
    exchanged = _exchanged(anomalies[0], anomalies[1], shown.mean_speed_rad_s) if case.method == "joint" else None
    if certain == [exchanged]:
        return "inconclusive", explanation.reason_exchanged(anomalies[0], anomalies[1])
    if certain:
        shown_before = [anomaly.name for anomaly in certain if anomaly.name in leaning]
        return "anomalous", explanation.reason_anomalous(certain, shown_before)
    lacking = "" if fits.adequate else f" while the friction model lacks something ({fits.finding})"
    if shown.unnamed_jumps and not lacking:
        lacking = " while friction jumps and the wheel file names no switching system ([[fss]])"
    for anomaly, entry, doubtful in zip(anomalies, judged, open_to_doubt, strict=True):
        what = explanation.title(entry.name)
        if _rested(anomaly):
            continue
        if low < entry.probability and (entry.probability < high or doubtful):
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
        if case.method == "joint" and _outside(anomaly, std, adequate=fits.adequate):
            return "inconclusive", explanation.reason_outside(anomaly, lacking, below=_below(anomaly))
    silent = [entry.name for entry in judged if not entry.telling]
    if silent:
        return (
            "inconclusive",
            explanation.reason_silent(silent, len(judged), lacking),
        )
    whole = case.wheel.window.samples
    if case.evidence.used < MIN_SHARE * whole:
        return "inconclusive", (
            f"Nothing is anomalous in these {case.evidence.used} samples, but a whole window has {whole}: they are too"
            " few to call the wheel nominal."
        )
    return "nominal", explanation.reason_nominal(anomalies, leaning, lacking)


def _nothing_to_judge(case: _Case) -> str:
    """Return why nothing can be judged, whatever the friction is; "" where it can."""
    if case.wheel.nominal is None:
        return "The wheel file has no [nominal], so there is nothing to compare the friction with."
    if case.model is None:
        return "There is no model, so no nominal range to compare the friction with."
    used = case.evidence.used / case.evidence.slots
    if used < MIN_COVERAGE:
        return (
            f"Only {100.0 * used:.0f} % of the window's slots hold a usable sample"
            f" ({100.0 * MIN_COVERAGE:.0f} % are needed)."
        )
    return ""


def _remedy(case: _Case, anomalies: Sequence[AnomalyDiagnosis], shown: _Shown, *, adequate: bool) -> str:
    """Return what helps an inconclusive window where waiting for the next one does not; "" where it does."""
    if case.wheel.nominal is None:
        return "Learn the wheel file from healthy recordings with rwa-monitor identify, or add [nominal] to it."
    if case.evidence.used < MIN_COVERAGE * case.evidence.slots:
        return explanation.CHECK_TELEMETRY
    if shown.unnamed_jumps:
        return "Learn its switching systems from longer recordings with rwa-monitor identify: waiting does not help."
    if adequate and any(_below(anomaly) and not anomaly.active for anomaly in anomalies[:2]):
        return "Friction hardly falls below nominal: check units, sign and the wheel file before the wheel."
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


def _outside(anomaly: AnomalyDiagnosis, std: float, *, adequate: bool) -> bool:
    """Return whether an estimate contradicts that its friction is nominal, `std` [the anomaly's unit] its deviation.

    It does outside the nominal range by more than that. Where the friction model does not fit, the deviation holds what
    is missing, and the range must hold all of it.
    """
    if anomaly.estimate is None or anomaly.nominal_low is None or anomaly.nominal_high is None:
        return False
    beyond = max(anomaly.estimate - anomaly.nominal_high, anomaly.nominal_low - anomaly.estimate)
    return beyond > (std if adequate else -std)


# ---- into SI units ---------------------------------------------------------------------------------------------------


def viscous_unit(wheel: Wheel) -> float:
    """Return what one normalised unit of viscous friction is [N m s/rad]."""
    return wheel.torque_unit_Nm / wheel.speed_unit_rad_s


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _scaled(value: float, unit: float) -> float | None:
    return _finite(value * unit)


def _value(value: float, std: float, unit: float, name: str) -> Value:
    return Value(_scaled(value, unit), _scaled(std, unit), name)


def _anomaly(wheel: Wheel, judged: Judged, model: AnomalyModel | None, features: Features, a: int) -> AnomalyDiagnosis:
    """Return one entry of the diagnosis: estimate, nominal range and severity in SI units."""
    levels: Levels | None
    if a == 0:
        value, std, unit, name = features.base_dry, features.base_dry_std, wheel.torque_unit_Nm, DRY_UNIT
        levels = model.levels[0] if model else None
    elif a == 1:
        nominal = wheel.nominal.viscous_Nm_s_rad if wheel.nominal else 0.0
        value, std, name = features.viscous, features.viscous_std, VISCOUS_UNIT
        unit = nominal if nominal > 0 else viscous_unit(wheel)
        levels = model.levels[0] if model else None
    else:
        q, value, std = features.systems[a - 2].highest()
        unit, name = wheel.torque_unit_Nm, DRY_UNIT
        if q == 0 and model is not None:
            # At rest a system has no friction, healthy or not; its severity could be anything up to the learned one.
            return AnomalyDiagnosis(judged.name, judged.active, judged.probability, 0.0, 1.0, 0.0, 0.0, 0.0, name)
        levels = model.levels[q] if model else None
    severity = severity_std = None
    if levels is not None and levels.median is not None and levels.median > levels.nominal_high:
        width = levels.median - levels.nominal_high
        severity = _finite(max(0.0, (value - levels.nominal_high) / width))
        severity_std = _finite(std / width)
    return AnomalyDiagnosis(
        name=judged.name,
        active=judged.active,
        probability=judged.probability,
        severity=severity,
        severity_std=severity_std,
        estimate=_scaled(value, unit),
        nominal_low=levels.nominal_low * unit if levels else None,
        nominal_high=levels.nominal_high * unit if levels else None,
        unit=name,
    )


def _shown(case: _Case, features: Features, assignment: Assignment) -> _Shown:
    wheel = case.wheel
    nominal = wheel.nominal.viscous_Nm_s_rad if wheel.nominal else 0.0
    deviations = (
        features.base_dry_std * wheel.torque_unit_Nm,
        features.viscous_std * (nominal if nominal > 0 else viscous_unit(wheel)),
        *(system.highest()[2] * wheel.torque_unit_Nm for system in features.systems),
    )
    whole = case.evidence.sums.between(np.zeros(1, dtype=np.int64), np.array([case.evidence.slots]))
    return _Shown(
        # The paper's method judges each system by itself, whatever it did.
        unmoved=(
            False,
            False,
            *(case.method == "joint" and system.configuration.size < 2 for system in features.systems),
        ),
        deviations=tuple(std if math.isfinite(std) else 0.0 for std in deviations),
        unnamed_jumps=not wheel.fss and bool((assignment.system != REJECTED).any()),
        mean_speed_rad_s=float(whole.x[0] / whole.n[0]) * wheel.speed_unit_rad_s,
    )


def _diagnosis(
    case: _Case,
    models: Sequence[AnomalyModel | None],
    stages: _Stages,
    judgement: Judgement,
) -> WindowDiagnosis:
    fits = stages.fits
    wheel, features = case.wheel, judgement.features
    torque, viscous = wheel.torque_unit_Nm, viscous_unit(wheel)
    anomalies = tuple(
        _anomaly(wheel, judged, learned, features, a)
        for a, (judged, learned) in enumerate(zip(judgement.anomalies, models, strict=True))
    )
    shown = _shown(case, features, stages.assignment)
    verdict, reason = _verdict(case, judgement.anomalies, anomalies, fits, shown)
    return WindowDiagnosis(
        verdict=verdict,
        reason=reason,
        anomalies=anomalies,
        base_dry=_value(features.base_dry, features.base_dry_std, torque, DRY_UNIT),
        viscous=_value(stages.components.viscous, stages.components.viscous_std, viscous, VISCOUS_UNIT),
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
            _scaled(stages.estimate.rmse, torque),
            _scaled(stages.estimate.excess_rmse, torque),
            _scaled(case.evidence.noise.std, torque),
        ),
        model_adequate=fits.adequate,
        suspected_effect=fits.suspected_effect,
        explanation=explanation.explain(
            verdict,
            reason,
            anomalies,
            base_known=stages.features.base_known,
            windows_before=case.carried.windows if case.method == "joint" else 0,
            adequacy=fits,
            remedy=_remedy(case, anomalies, shown, adequate=fits.adequate) if verdict == "inconclusive" else "",
        ),
        features=stages.features,
        **case.provenance(),
    )


def changepoints_of(assignment: Assignment, wheel: Wheel) -> tuple[Changepoint, ...]:
    """Return all candidates of an assignment in SI units, sorted by slot."""
    names = {REJECTED: "rejected", UNATTRIBUTED: "unattributed"}
    names |= {s: system.name for s, system in enumerate(wheel.fss)}
    torque = wheel.torque_unit_Nm
    order = np.argsort(assignment.index, kind="stable")
    # Of two jumps with no usable sample between them only the sum is known: either may be all of it.
    open_ended = ~np.isfinite(assignment.jump_std)
    std = np.where(open_ended, np.abs(assignment.jump[open_ended]).sum(), assignment.jump_std)
    columns = (assignment.index, assignment.jump * torque, std * torque, assignment.system, assignment.confidence)
    return tuple(
        Changepoint(index, jump_Nm, std_Nm, names[system], confidence)
        for index, jump_Nm, std_Nm, system, confidence in zip(*(c[order].tolist() for c in columns), strict=True)
    )


def _too_few(case: _Case, models: Sequence[AnomalyModel | None]) -> WindowDiagnosis:
    """Return the diagnosis of a window that holds next to nothing: all there is to say is that."""
    systems = case.wheel.fss
    no_sojourns = SystemFeatures("", np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0), rests=True)
    features = Features(math.nan, math.nan, math.nan, math.nan, (no_sojourns,) * len(systems))
    judged = unjudged(features, case.wheel.anomalies).anomalies
    reason = f"Only {case.evidence.used} of the window's {case.evidence.slots} slots hold a usable sample."
    return WindowDiagnosis(
        verdict="inconclusive",
        reason=reason,
        anomalies=tuple(
            _anomaly(case.wheel, entry, learned, features, a)
            for a, (entry, learned) in enumerate(zip(judged, models, strict=True))
        ),
        base_dry=Value(None, None, DRY_UNIT),
        viscous=Value(None, None, VISCOUS_UNIT),
        fss=tuple(SystemFriction(system.name, (), (), ()) for system in systems),
        changepoints=(),
        fit=Fit(None, None, None),
        model_adequate=True,
        suspected_effect=None,
        explanation=f"{reason} {explanation.CHECK_TELEMETRY}",
        features=features,
        **case.provenance(),
    )
