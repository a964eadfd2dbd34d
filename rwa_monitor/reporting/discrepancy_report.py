"""The discrepancy report: as text, and as one self-contained HTML page, for instance for a review board."""

import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import jinja2
from rich.console import RenderableType
from rich.table import Table

from rwa_monitor.discrepancy.bench import SCALED_ONLY
from rwa_monitor.discrepancy.diagnosis_gain import WINDOWS
from rwa_monitor.discrepancy.extended import extend, laws_in_words
from rwa_monitor.discrepancy.hypotheses import Detectable, as_clause, candidates, detectable_strengths, not_testable
from rwa_monitor.discrepancy.likelihood import least_gain
from rwa_monitor.discrepancy.p_values import built_in_null_distribution
from rwa_monitor.discrepancy.plan import Plan, plan
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import left_out_in_words
from rwa_monitor.discrepancy.result import DiscrepancyResult, FoundEffect, Search, nested_models
from rwa_monitor.messages import Gain
from rwa_monitor.reporting.residual_views import all_views
from rwa_monitor.wheel.effects.catalogue import effect_class
from rwa_monitor.words import SOFTWARE

KINDS: Final = {"mean": "a torque", "noise": "of the noise", "switching": "of the jumps"}
PROPER: Final = "Stribeck"  # a proper name keeps its capital
MOST_NAMES: Final = 4  # equivalent effects from which the sentence states how to separate them
SURE_P: Final = 1e-4  # p-value below which a view's deviation is reported as significant


def sentence(result: DiscrepancyResult) -> str:
    """Return the verdict in one sentence."""
    if result.verdict == "adequate":
        return "The simulation explains these data; nothing that could be tested is missing."
    if result.verdict == "untestable":
        return "Untestable with these data: the speed hardly varies, and no effect that needs motion would show."
    parts = [_name_in_words(effect) for effect in result.effects]
    if result.unexplained is not None:
        left, stands_in = result.unexplained, " (an effect named here may mimic a part of it)" if parts else ""
        nearest = f"; {left.nearest.effect} comes nearest, with {left.nearest.share:.0%}" if left.nearest else ""
        parts.append(f"{left.signature}, {left.size_Nm:.2g} N m rms, that no known effect explains{nearest}{stands_in}")
    lacks = f"The simulation lacks {('; and ' if any(',' in one for one in parts) else ' and ').join(parts)}."
    simulated = result.gain.simulated
    if simulated is not None and simulated.is_a_loss:
        lacks += f" What was found {simulated.note}."
    if result.gain.is_a_loss:
        return f"{_loss_in_words(result, result.gain)} {lacks}"
    if result.gain.only_by_fewer_jumps:
        return f"{lacks} On held-out data that leaves no less error, and needs fewer jumps for it."
    return lacks


def _loss_in_words(result: DiscrepancyResult, gain: Gain) -> str:
    """Return the first sentence where an extension fails on held-out data: the loss in error and log score."""
    own = [effect.name for effect in result.effects if effect_class(effect.name).of_one_recording and gain.held_out]
    where = f"On {', '.join(gain.held_out)}" if gain.held_out else "On blocks left out in turn"
    return (
        f"{where} what was found does not hold: the RMSE goes from {gain.rmse_base_Nm:.4g} to"
        f" {gain.rmse_extended_Nm:.4g} N m, the log score from {gain.log_score_base:.4f} to"
        f" {gain.log_score_extended:.4f} a sample; do not extend the wheel file by it."
        + "".join(f" {name} could not carry over: it counts from a recording's own beginning." for name in own)
        + " On the searched records:"
    )


def _name_in_words(effect: FoundEffect) -> str:
    if len(effect.equivalent) >= MOST_NAMES:
        names = effect.name, *effect.equivalent
        return f"one of {len(names)} effects alike in these data ({', '.join(names)}): {as_clause(effect.separate_by)}"
    others = f" or, indistinguishable by these data, {', '.join(effect.equivalent)}" if effect.equivalent else ""
    name, title = effect.name, effect_class(effect.name).title
    words = title if title.startswith(PROPER) else title[:1].lower() + title[1:]
    plain = name.replace("_", " ")
    if words == plain:
        return f"{name}{others}"
    return f"{words if words.startswith(f'{plain} (') else f'{name} ({words})'}{others}"


def p_in_words(search: Search, effect: FoundEffect) -> str:
    """Return a p-value, with "≤" where the null distribution goes no further."""
    floor = built_in_null_distribution().floor(effect.family, derived=search.problem.friction_is_derived)
    return f"{'≤ ' if effect.p_value <= floor else ''}{probability(effect.p_value)}"


def steps_in_words(problem: Problem) -> str:
    """Return the quantisation steps of the torque and their size relative to the noise; "" without such steps."""
    found = []
    for steps in {record.steps: None for record in problem.records if record.steps is not None}:
        size, share = measure(steps.size, None, steps.unit), steps.torque_Nm / problem.noise.std
        found.append(f"{steps.channel} is quantised in steps of {size}, {share:.2g} σ of the noise")
    return "; ".join(found)


def noise_gains(search: Search) -> list[tuple[str, float]]:
    """Return each noise effect found with its gain in nats per sample, in sample, by its law of the noise.

    It does not change the model's mean: the error of the model stays.
    """
    size = search.problem.size
    return [(e.name, 0.5 * e.delta_deviance / size) for e in search.result.effects if e.family == "noise"]


def absent_effects(search: Search) -> list[Detectable]:
    """Return the effects that are detectable in these data and were not found, with the least detectable strength."""
    named = {name for effect in search.result.effects for name in (effect.name, *effect.equivalent)}
    others = named | {name for name, _ in search.result.untested}
    return [
        entry
        for entry in detectable_strengths(search.problem, search.extended, candidates(search.wheel, search.problem))
        if not entry.too_weak and entry.name not in others
    ]


# ---- text ------------------------------------------------------------------------------------------------------------


def details(found: Search) -> Iterator[RenderableType]:
    """Yield the table of effects, the gain, and the effects that could not be tested, part by part."""
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
    yield from _rendered("discrepancy_report.txt", found).splitlines()


def plan_lines(planned: Plan) -> list[str]:
    """Return the lines of a plan: the advice, and how well each manoeuvre separates the most likely causes."""
    return _environment().get_template("manoeuvres.txt").render(planned=planned).splitlines()


# ---- the page --------------------------------------------------------------------------------------------------------


def html(search: Search, sources: list[str], build: str = "") -> str:
    """Return the report as an HTML page; `sources` names the recordings, `build` the program's source version."""
    return _rendered(
        "discrepancy_report.html",
        search,
        sources=sources,
        software=f"{SOFTWARE}, build {build}" if build else SOFTWARE,
        views=all_views(search.problem, search.base, search.extended),
    )


def _rendered(template: str, search: Search, **more: Any) -> str:
    """Return a search rendered by a template."""
    beyond = not_testable(search.problem, search.result.untested)
    known = {"search": search, "extension": extend(search), "beyond": beyond}
    return _environment().get_template(template).render(**known, **more)


def _environment() -> jinja2.Environment:
    """Return the environment of the templates, with their filters and functions."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=jinja2.select_autoescape(["html"]),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"torque": lambda value: measure(value, None, "N m"), "probability": probability}
    of_others = as_clause, effect_class, laws_in_words, least_gain, left_out_in_words, nested_models, plan
    own = absent_effects, in_words, measure, noise_gains, p_in_words, picture, sentence, steps_in_words
    environment.globals |= {used.__name__: used for used in (*of_others, *own)}
    environment.globals |= {"KINDS": KINDS, "SURE_P": SURE_P, "SCALED_ONLY": SCALED_ONLY, "WINDOWS": WINDOWS}
    return environment


def picture(name: str, *drawn: Any, tight: bool = False, **options: Any) -> str:
    """Return a picture of `figures` as SVG; "" where the drawing library is not installed."""
    try:
        from rwa_monitor.reporting import figures  # noqa: PLC0415 - of an extra
    except ModuleNotFoundError:
        return ""
    return figures.svg(getattr(figures, name)(*drawn, **options), tight=tight)


# ---- numbers in engineering notation, with as many digits as are significant and prefixes ----------------------------

PREFIXES: Final = {0: "", -3: "m", -6: "µ", -9: "n", -12: "p", 3: "k", 6: "M"}
PREFIXED: Final = ("N m", "A", "V")  # units that take a prefix, also at the beginning of a compound unit
PREFIXED_ALONE: Final = ("s", "Hz")  # units that take a prefix only by themselves
PLAIN_FROM, PLAIN_TO = 1e-3, 1e4  # without prefix: sizes written without a power of ten
SUPERSCRIPTS: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
DIGITS: Final = 4  # of a value whose error is not known


def measure(value: float | None, std: float | None, unit: str) -> str:
    """Write a value with its standard deviation and unit, such as "500.30 ± 0.79 µN m"; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    error = std if std is not None and math.isfinite(std) and std > 0 else 0.0
    largest = max(abs(value), error)
    power = thousands(largest) if _takes_prefix(unit) else _plain_power(largest)
    value, error = value / 10.0**power, error / 10.0**power
    if error:
        decimals = min(max(1 - math.floor(math.log10(error)), 0), 12)
        number = f"{value:.{decimals}f} ± {error:.{decimals}f}"
    else:
        number = f"{value:.{DIGITS}g}"
    if _takes_prefix(unit):
        return f"{number} {PREFIXES[power]}{unit}"
    if power:
        number = (f"({number})" if error else number) + f"·10{str(power).translate(SUPERSCRIPTS)}"
    return number if unit == "-" else f"{number} {unit}"


def thousands(size: float) -> int:
    """Return the power of ten, a multiple of three that has a prefix, by which a size has one to three whole digits."""
    if size <= 0 or not math.isfinite(size):
        return 0
    return min(max(3 * math.floor(math.log10(size) / 3), min(PREFIXES)), max(PREFIXES))


def probability(p: float) -> str:
    """Write a probability."""
    if p < (rounding := sys.float_info.epsilon):
        return f"< 10{str(math.floor(math.log10(rounding))).translate(SUPERSCRIPTS)}"
    if p >= PLAIN_FROM:
        return f"{p:.2g}"
    power = math.floor(math.log10(p))
    return f"{p / 10.0**power:.1f}·10{str(power).translate(SUPERSCRIPTS)}"


def in_words(parameter: str, unit: str) -> str:
    """Return a parameter's name in words: "stribeck_speed_rad_s" in rad/s is its Stribeck speed."""
    ending = "_" + unit.replace("N m", "Nm").replace("²", "2").replace("/", "_").replace(" ", "_")
    return parameter.removesuffix(ending).replace("_", " ").replace("stribeck", "Stribeck").replace("ar c", "AR c")


def _takes_prefix(unit: str) -> bool:
    return unit in PREFIXED_ALONE or any(
        unit == first or unit.startswith((f"{first} ", f"{first}/")) for first in PREFIXED
    )


def _plain_power(size: float) -> int:
    return 0 if size <= 0 or PLAIN_FROM <= size < PLAIN_TO else math.floor(math.log10(size))
