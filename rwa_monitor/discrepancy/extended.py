"""The extended wheel: the effects found, and a base law that is consistent with them.

An effect is seldom orthogonal to dry and viscous friction: fitted together with it, the base law changes. Where the
file's base law already contains a part of the effects, adding them alone would count that part twice. Whether it does
depends on how the wheel's file was made: a coefficient from the manufacturer, or from records without the effect,
describes the wheel without it; one learned (`identify`) from records with the effect contains a part of it. The record
decides: in the first case the base law fitted with the effects is nearer the file's, in the second that without them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from rwa_monitor.discrepancy.base_fit import remove_levels, segment_starts
from rwa_monitor.discrepancy.found_effects import spread
from rwa_monitor.discrepancy.own_jumps import OwnJumps
from rwa_monitor.discrepancy.plausible import ImpliedValue, ask_speed_unit
from rwa_monitor.discrepancy.problem import Problem, rms
from rwa_monitor.discrepancy.record import limits_of, temperature_range
from rwa_monitor.discrepancy.result import Search, simulated_gain
from rwa_monitor.discrepancy.score import of_least_error
from rwa_monitor.discrepancy.terms import Model
from rwa_monitor.messages import SimulatedGain
from rwa_monitor.samples import TINY, FloatArray
from rwa_monitor.wheel.effects.base import Effect
from rwa_monitor.wheel.effects.catalogue import build, effect_class, mean_effects, to_block
from rwa_monitor.wheel.file_content import rounded
from rwa_monitor.wheel.wheel import EffectBlock, Nominal, Wheel

Treatment = Literal["kept", "one speed", "shifted", "absent"]
LOWEST_SHARE: Final = 0.05  # quantile of the level over samples that is the dry friction: the lowest lasting level
LEAST_OF_NOMINAL: Final = 1e-3  # of the file's coefficient: a shifted one is not less, since it must not vanish
COMMENTS: Final[dict[Treatment, str]] = {
    "kept": "dry and viscous friction are the wheel file's: it holds the wheel without the effects",
    "one speed": "dry and viscous friction are the wheel file's: at one speed nothing separates them",
    "shifted": "dry and viscous friction were learned with the effects in them; what they now explain is taken out",
    "absent": "the wheel file has no nominal friction; identify would learn it",
}

CAUTION: Final = "What an effect here explains is no longer seen as a fault: the records must be of a healthy wheel."
CAUTION_LOSS: Final = "It does worse than the file without the effects on held-out data: do not use it."
CAUTION_SIMULATED: Final = (
    "Simulated on the searched records it does worse than the file without the effects: do not use it."
)
NO_FRICTION: Final = "below zero, which dry friction cannot be: the law does not hold near rest"
CAUTION_DRIFT: Final = (
    "A drift can be the fault itself: do not extend the wheel file while friction moves; compare with the last healthy"
    " windows."
)


@dataclass(frozen=True, slots=True)
class BaseLaw:
    """Dry and viscous friction of a fitted model.

    Attributes
    ----------
    dry_Nm, viscous_Nm_s_rad, viscous_std
        The lowest lasting level [N m], the slope and its standard deviation [N m s/rad].
    at_bound
        Whether the slope is at its bound.
    one_speed_rad_s
        Mean speed where all data are at one speed [rad/s]: only the sum of the two is known there. None elsewhere.
    """

    dry_Nm: float
    viscous_Nm_s_rad: float
    viscous_std: float
    at_bound: bool
    one_speed_rad_s: float | None = None

    def at(self, speed_rad_s: float) -> float:
        """Return dry and viscous friction together at a speed [N m]."""
        return self.dry_Nm + self.viscous_Nm_s_rad * speed_rad_s


@dataclass(frozen=True, slots=True)
class Extension:
    """The extended wheel and the origin of its base law.

    Attributes
    ----------
    wheel
        With the effects.
    treatment
        How the nominal friction of the file was treated.
    before, after
        The base law fitted to these records without the effects and with them.
    simulated
        RMSE of the friction simulated by the two wheel files on the recorded speed, with the same segments in both and
        each segment's level fitted.
    rmse_simulated_Nm
        RMSE of the extended file with its own dry friction as the level [N m]; NaN without a nominal friction.
    is_a_loss
        Whether it does worse on held-out data than the file without the effects.
    """

    wheel: Wheel
    treatment: Treatment
    before: BaseLaw
    after: BaseLaw
    simulated: SimulatedGain
    rmse_simulated_Nm: float
    is_a_loss: bool = False

    def to_toml(self) -> str:
        """Return the wheel file's text, with the comment and warnings on top."""
        drifts = any(build(block).changes_with_time for block in self.wheel.effect)
        cautions = [CAUTION_LOSS] if self.is_a_loss else []
        cautions += [CAUTION_SIMULATED] if self.simulated.is_a_loss else []
        nominal = f"In [nominal], {COMMENTS[self.treatment]}."
        lines = [nominal, *cautions, f"{CAUTION} {CAUTION_DRIFT}" if drifts else CAUTION]
        return "".join(f"# {line}\n" for line in lines) + self.wheel.to_toml()


def extended_wheel(search: Search) -> Wheel:
    """Return the wheel with the mean effects found added, and the nominal friction that is consistent with them."""
    return extend(search).wheel


def extend(search: Search, report_sha256: str | None = None) -> Extension:
    """Return the extended wheel, how its nominal friction was treated, and how well it fits the records.

    Its effects carry the standard deviations of their parameters, and the hash of the report, where it is given.
    """
    problem, base, model = search.problem, search.base, search.extended
    before, after = base_law(problem, base), base_law(problem, model)
    # Compared by the median change of the level at the same samples: false jumps of the base model are not friction.
    before = replace(before, dry_Nm=after.dry_Nm + float(np.median(base.fit.level - model.fit.level)))
    nominal, treatment = _nominal(search.wheel.nominal, before, after)
    blocks = []
    for index, term in enumerate(model.terms):
        if issubclass(term.effect, OwnJumps):
            values = {name: found.value for name, found in term.effect.nearest(search.problem, model, index).items()}
        else:
            names = [parameter.name for parameter in term.effect.strength_parameters()]
            values = {**term.shape, **dict(zip(names, model.strengths(index).tolist(), strict=True))}
        effect = effect_class(term.effect.name)
        known = {parameter.name: values[parameter.name] for parameter in effect.parameters}
        blocks.append(_with_errors(search, effect(**known), report_sha256))
    limits = limits_of(search.wheel, problem.records)
    added: dict[str, Any] = {"effect": (*search.wheel.effect, *blocks), "nominal": nominal, "limits": limits}
    if any(term.effect.follows_temperature for term in model.terms):
        added["temperature"] = temperature_range(search.problem.records)
    wheel = search.wheel.model_copy(update=added)
    errors = [
        min(_rmse(search, of, float(one.fit.coefficients[0])) for one in (fitted, of_least_error(problem, fitted)))
        for of, fitted in ((search.wheel, base), (wheel, model))
    ]
    extension = Extension(
        wheel,
        treatment,
        before,
        after,
        simulated_gain(*errors),
        _rmse(search, wheel, after.viscous_Nm_s_rad, nominal.dry_torque_Nm) if nominal else float("nan"),
        search.result.gain.is_a_loss,
    )
    # The records were searched, and are compared here, without the effects that were taken out of them.
    taken_out = (_with_errors(search, effect, report_sha256) for effect in search.taken_out)
    return replace(extension, wheel=wheel.model_copy(update={"effect": (*wheel.effect, *taken_out)}))


def _with_errors(search: Search, effect: Effect, report_sha256: str | None) -> EffectBlock:
    """Return the block of an effect, with the standard deviations of its parameters where they are known."""
    std = {
        name: rounded(value.std)
        for found in search.result.effects
        if found.name == effect.name
        for name, value in found.parameters.items()
        if value.std is not None
    }
    return to_block(effect).model_copy(update={"std": std or None, "report_sha256": report_sha256})


def base_law(problem: Problem, model: Model) -> BaseLaw:
    """Return the dry and viscous friction of a fitted model."""
    dry = float(np.quantile(model.fit.level, LOWEST_SHARE, method="nearest"))
    viscous = float(model.fit.coefficients[0])
    speed = float(problem.speed.mean()) if problem.at_one_speed else None
    std, _ = spread(problem, model)
    return BaseLaw(dry, viscous, std, viscous <= problem.lowest_viscous, speed)


def speed_unit_question(search: Search) -> str | None:
    """Ask about the unit of the speed if the fitted viscous friction is the wheel file's in another unit; else None."""
    if search.wheel.nominal is None:
        return None
    law = base_law(search.problem, search.base)
    return ask_speed_unit(ImpliedValue(law.viscous_Nm_s_rad, law.viscous_std), search.wheel.nominal.viscous_Nm_s_rad)


def laws_in_words(extension: Extension) -> list[str]:
    """Return one line each on the base law's change, its treatment, and the extended file's RMSE on the records."""
    before, after = extension.before, extension.after
    if after.one_speed_rad_s is None:
        impossible = f"; {NO_FRICTION}" if min(before.dry_Nm, after.dry_Nm) < 0 else ""
        dry = f"dry {before.dry_Nm:.4g} → {after.dry_Nm:.4g} N m (lowest lasting level{impossible})"
        law = f"{dry}, viscous {_with_std(before)} → {_with_std(after)} N m s/rad"
    else:
        speed = after.one_speed_rad_s
        law = (
            f"{before.at(speed):.4g} → {after.at(speed):.4g} N m at {speed:.4g} rad/s: how much of that is dry and how"
            " much viscous is not known at one speed"
        )
    simulated = extension.simulated
    check = f"RMSE {simulated.rmse_base_Nm:.4g} → {simulated.rmse_extended_Nm:.4g} N m with the effects"
    if simulated.is_a_loss and extension.wheel.effect:
        check += " (does not hold when simulated)"
    if not extension.wheel.fss and np.isfinite(extension.rmse_simulated_Nm):
        check += f", at the file's own dry friction {extension.rmse_simulated_Nm:.4g} N m"
    return [
        f"base law fitted to these records: {law}",
        f"extended wheel file: {COMMENTS[extension.treatment]}",
        f"the wheel file, simulated on this record's speed, at the levels of its segments: {check}",
    ]


def _with_std(law: BaseLaw) -> str:
    at_bound = " (friction cannot be less)" if law.at_bound else ""
    return f"{law.viscous_Nm_s_rad:.4g} ± {law.viscous_std:.2g}{at_bound}"


def _nominal(nominal: Nominal | None, before: BaseLaw, after: BaseLaw) -> tuple[Nominal | None, Treatment]:
    """Return the nominal friction of the extended wheel.

    Both coefficients are treated alike: the file was learned with the effects or it was not. Distances are relative to
    the file's own coefficients: relative anomalies of the two are about equally likely.
    """
    if nominal is None:
        return None, "absent"
    if after.one_speed_rad_s is not None:
        return nominal, "one speed"
    known = np.array([nominal.dry_torque_Nm, nominal.viscous_Nm_s_rad])
    without_effects, with_effects = (np.array([law.dry_Nm, law.viscous_Nm_s_rad]) for law in (before, after))
    off = ((known - [with_effects, without_effects]) / np.maximum(np.abs(known), TINY)) ** 2
    if off[0].sum() <= off[1].sum():
        return nominal, "kept"
    dry, viscous = np.maximum(known + with_effects - without_effects, LEAST_OF_NOMINAL * known).tolist()
    shifted = {"dry_torque_Nm": dry, "viscous_Nm_s_rad": viscous}
    unknown = {"dry_torque_std_Nm": None, "viscous_std_Nm_s_rad": None}
    return nominal.model_copy(update={**shifted, **unknown}), "shifted"


def _rmse(search: Search, wheel: Wheel, viscous_Nm_s_rad: float, dry_Nm: float | None = None) -> float:
    """Return the RMS of friction minus the wheel's law, at one dry level or with each segment's level fitted [N m].

    The viscous coefficient is used where the wheel file has none.
    """
    problem = search.problem
    # The effects of the original wheel file are already subtracted from the records (`without_known_effects`).
    added = wheel.model_copy(update={"effect": wheel.effect[len(search.wheel.effect) :]})
    viscous = wheel.nominal.viscous_Nm_s_rad if wheel.nominal else viscous_Nm_s_rad
    level = search.extended.fit.level if dry_Nm is None else np.full(problem.size, dry_Nm)
    torques = []
    for record, dry in zip(problem.records, problem.spread(level), strict=True):
        channels = replace(record.channels, dry_level_Nm=dry)
        torque = viscous * record.viscous_speed_rad_s
        for effect in mean_effects(added):
            torque = torque + np.nan_to_num(effect.torque(channels)[0])
        torques.append(torque)
    rest: FloatArray = problem.z - problem.sign * problem.gather(torques)
    if added.effect:  # jumps of these records are fitted, as levels are: a wheel file has their law, not their times
        rest = rest - search.extended.of_own_jumps
    inner = remove_levels(rest, segment_starts(problem, search.extended.fit.jumps)) if dry_Nm is None else rest - dry_Nm
    return rms(inner)
