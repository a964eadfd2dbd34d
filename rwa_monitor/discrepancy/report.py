"""The discrepancy report: one self-contained HTML page that an engineer can put before a review board."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import jinja2
import numpy as np

from rwa_monitor.discrepancy import figures
from rwa_monitor.discrepancy.extended import extend, laws_in_words
from rwa_monitor.discrepancy.find import CANDIDATES, Search
from rwa_monitor.discrepancy.gain import BLOCKS
from rwa_monitor.discrepancy.nulls import built_in_nulls
from rwa_monitor.discrepancy.plan import PlannedManoeuvre, rank_manoeuvres
from rwa_monitor.discrepancy.report_template import PAGE
from rwa_monitor.discrepancy.result import DiscrepancyResult, FoundEffect
from rwa_monitor.discrepancy.search import ACCEPT_GAIN
from rwa_monitor.discrepancy.untested import detectable_strengths
from rwa_monitor.discrepancy.views import all_views
from rwa_monitor.physics.effects.catalogue import CATALOGUE, MEAN_EFFECTS
from rwa_monitor.version import SOFTWARE

SURE_P: Final = 1e-4  # below which a view's test calls its deviation no chance


@dataclass(frozen=True, slots=True)
class Rung:
    """One model of the ladder, with the gain over the one before and its 95 % interval."""

    name: str
    rmse_Nm: float
    log_score: float
    gain: float | None
    gain_low: float | None
    gain_high: float | None
    jumps: int


def sentence(result: DiscrepancyResult) -> str:
    """Return the verdict in one sentence."""
    if result.verdict == "adequate":
        return "The simulation explains these data; nothing that could be tested is missing."
    if result.verdict == "untestable":
        return "These data cannot tell: they hold no manoeuvre that would show a missing effect."
    parts = [_name_in_words(effect) for effect in result.effects]
    if result.unexplained is not None:
        parts.append(
            f"{result.unexplained.signature}, {result.unexplained.size_Nm:.2g} N m rms, that no known effect explains"
        )
    return f"The simulation lacks {'; and '.join(parts)}."


def _name_in_words(effect: FoundEffect) -> str:
    others = f" or, as well as these data can tell, {', '.join(effect.equivalent)}" if effect.equivalent else ""
    name, title = effect.name, CATALOGUE[effect.name].title
    words = title[:1].lower() + title[1:]
    plain = name.replace("_", " ")
    if words == plain:
        return f"{name}{others}"
    return f"{words if words.startswith(f'{plain} (') else f'{name} ({words})'}{others}"


def p_in_words(search: Search, effect: FoundEffect) -> str:
    """Return a p-value, with "≤" where the table of nulls tells no more."""
    floor = built_in_nulls().floor(effect.family, derived=search.problem.friction_is_derived)
    return f"{'≤ ' if effect.p_value <= floor else ''}{effect.p_value:.1e}"


def noise_gains(search: Search) -> list[tuple[str, float]]:
    """Return each noise effect found with what it is worth: nats per sample, in sample, by the right law of noise.

    It moves no sample: the error of the model stays.
    """
    size = search.problem.size
    return [(e.name, 0.5 * e.delta_deviance / size) for e in search.result.effects if e.family == "noise"]


def ladder(search: Search) -> list[Rung]:
    """Return the ladder of models with held-out gains; intervals from the spread over held-out blocks."""
    rungs = []
    for i, (model, score) in enumerate(zip(search.mean.ladder, search.scores, strict=True)):
        gain = low = high = None
        if i > 0:
            per_block = score.block_log_scores - search.scores[i - 1].block_log_scores
            gain = float(per_block.mean())
            half = 1.96 * float(per_block.std(ddof=1)) / float(np.sqrt(BLOCKS))
            low, high = gain - half, gain + half
        name = "simulation as it is" if i == 0 else f"+ {model.names[-1]}"
        rungs.append(Rung(name, score.rmse_Nm, score.log_score, gain, low, high, int(model.fit.jumps.size)))
    return rungs


def plan(search: Search) -> list[PlannedManoeuvre]:
    """Rank the manoeuvres that would best separate the leading causes; empty where no mean effect was found."""
    mean = [effect for effect in search.result.effects if effect.name in MEAN_EFFECTS]
    if not mean:
        return []
    leading = next((effect for effect in mean if effect.equivalent), mean[0])
    rivals = [leading.name, *(name for name in leading.equivalent if name in MEAN_EFFECTS)]
    return rank_manoeuvres(search.problem, search.extended, rivals, search.wheel)


def html(search: Search, sources: list[str]) -> str:
    """Return the report as an HTML page; `sources` names the recordings."""
    views = all_views(search.problem, search.base, search.extended)
    extended = bool(search.extended.terms)
    extension = extend(search)
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters["torque"] = _torque
    environment.filters["number"] = lambda value: "–" if value is None else f"{value:.4g}"
    facts: dict[str, Any] = {
        "result": search.result,
        "sentence": sentence(search.result),
        "sources": sources,
        "wheel": search.wheel,
        "samples": search.problem.size,
        "rest_slots": sum(record.rest_slots for record in search.problem.records),
        "clipped": round(search.problem.clipped_share * search.problem.size),
        "noise_std_Nm": search.problem.noise.std,
        "software": SOFTWARE,
        "catalogue": CATALOGUE,
        "rungs": ladder(search),
        "plan": plan(search),
        "detectable": [
            entry
            for entry in detectable_strengths(search.problem, search.extended, CANDIDATES)
            if not entry.too_weak and entry.name not in dict(search.result.untested)
        ],
        "p_values": {effect.name: p_in_words(search, effect) for effect in search.result.effects},
        "noise_gains": noise_gains(search),
        "sure_p": SURE_P,
        "accept_gain": f"{ACCEPT_GAIN:.0f}",
        "overlay": figures.svg(figures.overlay(search)),
        "ladder_picture": figures.svg(figures.ladder_picture(search)) if extended else "",
        "views": [(view, figures.svg(figures.view_picture(view, both=extended))) for view in views],
        "extended_toml": extension.to_toml() if extended else "",
        "laws": laws_in_words(extension) if extended else [],
    }
    return environment.from_string(PAGE).render(facts)


def _torque(value: float) -> str:
    """Write a torque in the unit in which it has one to three digits before the point."""
    factor, unit = figures.torque_unit(value)
    return f"{value * factor:.3g} {unit}"
