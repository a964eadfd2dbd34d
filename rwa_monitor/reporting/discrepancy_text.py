"""How a discrepancy report looks to a person: effects, gain, what was not seen or not testable; what to fly next."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import RenderableType
from rich.table import Table

from rwa_monitor.discrepancy.bench import SCALED_ONLY
from rwa_monitor.discrepancy.extended import extend, laws_in_words
from rwa_monitor.discrepancy.finished_search import Search
from rwa_monitor.discrepancy.hypotheses import CANDIDATES
from rwa_monitor.discrepancy.plan import Plan
from rwa_monitor.discrepancy.record import left_out_in_words
from rwa_monitor.discrepancy.untested import as_a_part, not_testable
from rwa_monitor.reporting.discrepancy_report import absent_effects, noise_gains, p_in_words, steps_in_words


def details(found: Search) -> Iterator[RenderableType]:
    """Give the table of effects, the gain, and what could not be tested, part by part."""
    result = found.result
    if result.effects:
        table = Table("effect", "parameters", "gain", "p", "equivalent", "separated by", box=None)
        for effect in result.effects:
            parameters = "\n".join(f"{name} = {p.in_words()}" for name, p in effect.parameters.items())
            table.add_row(
                effect.formula.partition(",")[0] or effect.name,
                parameters,
                f"{effect.delta_deviance:.0f}",
                p_in_words(found, effect),
                ", ".join(effect.equivalent) or "-",
                effect.separate_by,
            )
        yield table
    left_out = left_out_in_words(found.problem.records)
    yield f"{found.problem.size} samples in motion{f' ({left_out})' if left_out else ''}"
    steps = steps_in_words(found.problem)
    if steps:
        yield f"{steps}; taken out as far as the values show"
    gain = result.gain
    if gain is not None:
        where = ", ".join(gain.held_out) or "blocks left out in turn"
        yield (
            f"held out ({where}): RMSE {gain.rmse_base_Nm:.4g} → {gain.rmse_extended_Nm:.4g} N m "
            f"(noise {gain.noise_std_Nm:.4g}), "
            f"log score {gain.log_score_base:.4f} → {gain.log_score_extended:.4f} per sample, "
            f"jumps {gain.changepoints_base} → {gain.changepoints_extended}"
        )
        yield from (again.in_words() for again in (gain.searched_again, gain.searched_again_by_speed) if again)
        for name, worth in noise_gains(found):
            yield f"{name}: no less error; the right law of noise is worth {worth:.4f} nats per sample"
        if gain.diagnosis is not None:
            before, after = gain.diagnosis.before, gain.diagnosis.after
            yield (
                f"diagnosis of simulated windows with the effect in them: detection {before.detection:.0%} → "
                f"{after.detection:.0%}, false positives {before.false_positive:.1%} → {after.false_positive:.1%}, "
                f"false changepoints a window {before.false_changepoints:.1f} → {after.false_changepoints:.1f}"
            )
    if found.extended.terms:
        yield from laws_in_words(extend(found))
    not_seen = [f"{entry.name} {entry.in_words()}" for entry in absent_effects(found)]
    if not_seen:
        yield f"tested and not seen, down to about: {'; '.join(not_seen)}"
    beyond = not_testable(found.problem, CANDIDATES, result.untested)
    for name, missing in sorted(result.untested, key=lambda entry: entry[0] in beyond):
        off = missing.startswith(SCALED_ONLY)
        why = "not testable" if off or name in beyond else "not excited"
        yield f"{why}: {name} ({'' if off else 'needs '}{as_a_part(missing)})"


def plan_lines(planned: Plan) -> Iterator[str]:
    """Give the lines of a plan: the advice, and how well each manoeuvre separates the leading causes."""
    yield "what to fly next:"
    for line in planned.advice:
        yield f"  {line}"
    if planned.manoeuvres:
        yield f"  to {planned.question}:"
    for entry in planned.manoeuvres:
        pair = " and ".join(name for name in entry.worst_pair if name)
        shows = f"; shows {', '.join(entry.shows)}" if entry.shows else ""
        worth = f"{entry.separation:10.1f} nats in {entry.duration_s / 60:.0f} min ({entry.nats_per_hour:.1f} an hour)"
        if entry.shows:
            worth = f"{len(entry.shows):4d} effects, each by {worth.lstrip()}"
        yield f"  {worth}  {entry.name}: {entry.description} (hardest: {pair}{shows})"
