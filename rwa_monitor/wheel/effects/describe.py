"""An effect explained, as Markdown: the pages of the documentation are generated from the classes themselves."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rwa_monitor.wheel.effects.base import Effect, MeanEffect, Parameter

PARITY = {
    "odd": "changes sign when the whole motion is mirrored (speed, acceleration and current)",
    "even": "keeps its sign when the whole motion is mirrored (speed, acceleration and current)",
    "none": "has no symmetry between a motion and its mirror image",
}


def describe(effect: type[Effect]) -> str:
    """Return the page of an effect: formula, physics, parameters, signature, look-alikes, source.

    Parameters
    ----------
    effect
        A class of the catalogue.

    Returns
    -------
    str
        Markdown, ending with a line feed; the formula between double dollar signs.
    """
    lines = [
        f"# {effect.title}",
        "",
        f"`{effect.name}` · {effect.family} effect",
        "",
        effect.description,
        "",
        f"$${effect.formula}$$",
        "",
    ]
    if issubclass(effect, MeanEffect):
        lines += [f"The torque {PARITY[effect.parity]}.", ""]
    if effect.parameters:
        lines += ["| parameter | unit | kind | range | typical |", "|---|---|---|---|---|"]
        lines += [_row(parameter) for parameter in effect.parameters]
        lines.append("")
    lines += [f"**What shows it.** {effect.signature}", ""]
    if effect.confused_with:
        others = ", ".join(f"[`{name}`]({name}.md)" for name in effect.confused_with)
        lines += [f"**Looks like** {others}.", ""]
    lines += [f"**Separated by.** {effect.separate_by}", ""]
    if effect.needs:
        lines += [f"**Needs** {', '.join(f'`{channel}`' for channel in sorted(effect.needs))}.", ""]
    lines += [f"**Source.** {effect.source}", ""]
    return "\n".join(lines)


def index(effects: Iterable[type[Effect]]) -> str:
    """Return the page that lists effects by family, each with what shows it and a link to its page, as Markdown."""
    lines = ["# Effects the base model leaves out", ""]
    by_family: dict[str, list[type[Effect]]] = {"mean": [], "noise": [], "switching": []}
    for effect in effects:
        by_family[effect.family].append(effect)
    for family, members in by_family.items():
        lines += [f"## {family.capitalize()} effects", "", "| name | what | what shows it |", "|---|---|---|"]
        lines += [
            f"| [`{effect.name}`]({effect.name}.md) | {effect.title} | {effect.signature} |" for effect in members
        ]
        lines.append("")
    return "\n".join(lines)


def _row(parameter: Parameter) -> str:
    """Return one row of the table of parameters."""
    kind = "strength" if parameter.linear else "shape"
    typical = f"{parameter.typical:g}"
    if parameter.default is not None:
        typical += f" (default {parameter.default:g})"
    return f"| `{parameter.name}` | {parameter.unit} | {kind} | {range_in_words(parameter)} | {typical} |"


def range_in_words(parameter: Parameter) -> str:
    """Return the range of a parameter in words."""
    if parameter.choices:
        if parameter.between:
            return f"{parameter.low:g} … {parameter.high:g}"
        if len(parameter.choices) > 4:
            return f"{parameter.choices[0]:g}, {parameter.choices[1]:g} … {parameter.choices[-1]:g}"
        return " or ".join(f"{choice:g}" for choice in parameter.choices)
    bounded = math.isfinite(parameter.low), math.isfinite(parameter.high)
    if bounded == (True, True):
        return f"{parameter.low:g} … {parameter.high:g}"
    if bounded == (True, False):
        return f"≥ {parameter.low:g}"
    if bounded == (False, True):
        return f"≤ {parameter.high:g}"
    return "any"
