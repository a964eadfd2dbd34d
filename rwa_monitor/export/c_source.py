"""The friction model as one C99 file and its header: no allocation, libm alone."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import jinja2

from rwa_monitor.export.cost import cost
from rwa_monitor.export.model import FrictionModel, Part
from rwa_monitor.export.recording import literal
from rwa_monitor.simulation.record import COUPLING_ROUNDS
from rwa_monitor.version import SOFTWARE

FOLDER: Final = Path(__file__).parent
RECURSIONS: Final = FOLDER.parent / "kernels" / "recursions.h"
PLAIN: Final = str.maketrans({"±": "+-", "²": "2", "°": "deg", "·": " ", "−": "-", "ω": "w"})


def comment(text: str) -> str:
    """Return a text that stays inside of a comment in C, in ASCII: no file's content becomes code."""
    text = " ".join(text.translate(PLAIN).encode("ascii", "replace").decode().split())
    return re.sub(r"(?<=\?)(?=\?)", " ", text.replace("*/", "* /").replace("/*", "/ *"))


def error(std: float | None) -> str:
    """Return a standard deviation as it is stated."""
    return "not known" if std is None else f"{std:.2g}"


def constants(part: Part) -> str:
    """Return a line of comment for each constant of an effect, with its error."""
    lines = []
    for one in part.constants():
        unit = "" if one["unit"] == "-" else f" {comment(one['unit'])}"
        lines.append(f" *   {one['name']} = {one['value']!r}{unit}, error {error(one['std'])}")
    return "\n".join(lines)


def recursions(model: FrictionModel) -> str:
    """Return the functions of the kernels' header that the model calls."""
    parts = re.split(r"/\* -{4} (\w+) -+ \*/\n", RECURSIONS.read_text(encoding="utf-8"))
    return "".join(
        text for name, text in zip(parts[1::2], parts[2::2], strict=True) if name == "rwa_sign" or model.uses(name)
    )


def render(template: str, model: FrictionModel, **more: Any) -> str:
    """Return a template of this room, filled in for a model."""
    environment = jinja2.Environment(  # noqa: S701 - C is no HTML; XML escapes by the filter
        loader=jinja2.FileSystemLoader(FOLDER),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {"c": literal, "comment": comment, "error": error}
    environment.globals |= {"constants": constants, "cost": cost}
    known = {"model": model, "wheel": model.wheel, "software": SOFTWARE}
    return environment.get_template(f"{template}.jinja").render(**known, **more)


def c_files(model: FrictionModel) -> dict[str, str]:
    """Return header and source by the names of their files."""
    return {
        "rwa_friction.h": render("rwa_friction.h", model),
        "rwa_friction.c": render(
            "rwa_friction.c",
            model,
            recursions=recursions(model),
            free=[part for part in model.parts if not part.coupled],
            coupled=[part for part in model.parts if part.coupled],
            rounds=COUPLING_ROUNDS,
        ),
    }
