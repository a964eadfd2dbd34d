"""Errors that a user can act on: one clear line, its exit code, and what an unknown name was probably meant to be."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError

MAX_PART: Final = 500  # characters of the place of an error, and of its reason
# Of `difflib`, from 0 to 1. At its own 0.6 a key of another unit or meaning passes for a misspelt one.
LIKENESS: Final = 0.7
MAX_NAME: Final = 100  # characters: a longer name is none of ours, and comparing takes the square of its length


class RwaMonitorError(Exception):
    """Base of all errors that the command line shows as one line, without a traceback (exit code 1)."""


class MissingExtraError(RwaMonitorError):
    """A package that belongs to an extra is not installed."""


@contextmanager
def needs_extra(extra: str) -> Iterator[None]:
    """Raise MissingExtraError where an import in the block fails: what it takes belongs to this extra."""
    try:
        yield
    except ImportError as error:
        raise MissingExtraError(f"{error.name} is missing: pip install 'rwa-monitor[{extra}]'") from error


class InputError(RwaMonitorError):
    """Input that cannot be used: names the source (file or key), the place in it and the reason (exit code 2).

    Parameters
    ----------
    source
        What was read: a file name, a bus key, an option.
    reason
        What is wrong and, where it helps, what would be right.
    place
        Where in the source: "row 12, column speed_rad_s", "window.samples", …; empty for the whole of it.
    """

    def __init__(self, source: str, reason: str, place: str = "") -> None:
        self.source = source
        self.place = _shortened(place)
        self.reason = _shortened(reason)
        super().__init__(_one_line(": ".join(part for part in (source, self.place, self.reason) if part)))

    @classmethod
    def of_validation(
        cls, source: str, error: ValidationError, place: str = "", what: str = "", model: type[BaseModel] | None = None
    ) -> InputError:
        """Return the first thing that a pydantic model found wrong, with the field it is in.

        A key that is not known goes before what is missing: it may be that one, misspelt.

        Parameters
        ----------
        source
            What was read.
        error
            What pydantic raised.
        place
            Where no field is to blame but the whole.
        what
            Words before the reason, such as "is no model: ".
        model
            Where it is given, a key that is not known is reported with the ones that are.
        """
        found = error.errors(include_url=False, include_context=False)
        first = next((one for one in found if one["type"] == "extra_forbidden"), found[0])
        if first["type"] == "extra_forbidden" and model is not None:
            known = keys_at(model.model_json_schema(), first["loc"][:-1])
            hint = did_you_mean(str(first["loc"][-1]), known) or (f"; there are {', '.join(known)}" if known else "")
            first["msg"] = f"no key has this name{hint}"
        if first["type"] in {"union_tag_not_found", "union_tag_invalid"} and model is not None:
            first["msg"] = f"wants one of {'; '.join(alternatives_at(model.model_json_schema(), first['loc']))}"
        return cls(source, f"{what}{first['msg']}", ".".join(str(part) for part in first["loc"]) or place)

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str]]:
        """Keep all three parts when the error crosses a process border."""
        return (InputError, (self.source, self.reason, self.place))


def _shortened(text: str) -> str:
    """Return a text, cut where it is long: what is wrong may be a name of a million characters."""
    return text if len(text) <= MAX_PART else f"{text[: MAX_PART - 1]}…"


def _one_line(text: str) -> str:
    """Return a text with line breaks and other unprintable characters, as keys and names may hold them, escaped."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode("ascii") for c in text)


# ---- names that are not known ----------------------------------------------------------------------------------------


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return "; did you mean 'x'?" with the known name that is nearest, "" where none is near.

    Parameters
    ----------
    name
        What somebody wrote.
    known
        All that could have been written there.
    """
    nearest = closest(name, known)
    return f"; did you mean {nearest!r}?" if nearest else ""


def closest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that is nearest, upper and lower case alike; None where none is near."""
    if len(name) > MAX_NAME:
        return None
    # Here: it takes as long to load as all else that --help needs.
    from difflib import get_close_matches  # noqa: PLC0415

    by_lower = {one.lower(): one for one in known}
    found = get_close_matches(name.lower(), by_lower, n=1, cutoff=LIKENESS)
    return by_lower[found[0]] if found else None


def keys_at(schema: dict[str, Any], place: Sequence[str | int]) -> list[str]:
    """Return the keys that a JSON Schema has at a place, none where the place is not found.

    Parameters
    ----------
    schema
        As pydantic makes it of a model.
    place
        Keys and positions from the top, as pydantic's errors give them: of a union, the name of the alternative too.
    """
    return list(_at(schema, place).get("properties", ()))


def alternatives_at(schema: dict[str, Any], place: Sequence[str | int]) -> list[str]:
    """Return what a JSON Schema takes where one key selects the alternative, as they are written in TOML.

    Parameters
    ----------
    schema, place
        As for `keys_at`.

    Returns
    -------
    list of str
        Such as `{ law = "uniform", low = …, high = … }`; none where there is no such choice.
    """
    choice = _at(schema, place).get("discriminator", {})
    found = []
    for name, reference in choice.get("mapping", {}).items():
        others = [key for key in _resolved(schema, {"$ref": reference})["properties"] if key != choice["propertyName"]]
        keys = "".join(f", {key} = …" for key in others)
        found.append(f'{{ {choice["propertyName"]} = "{name}"{keys} }}')
    return found


def _at(schema: dict[str, Any], place: Sequence[str | int]) -> dict[str, Any]:
    """Return what a schema has at a place, {} where it is not found."""
    here = schema
    for part in place:
        here = _step(_resolved(schema, here), part)
    return _resolved(schema, here)


def _step(here: dict[str, Any], part: str | int) -> dict[str, Any]:
    """Return what lies one step below a part of a schema, {} where nothing is known of it."""
    if isinstance(part, int):
        below: Any = here.get("items")
    else:
        below = here.get("properties", {}).get(part) or here.get("discriminator", {}).get("mapping", {}).get(part)
        below = below or here.get("additionalProperties")
    if isinstance(below, str):
        return {"$ref": below}
    return below if isinstance(below, dict) else {}


def _resolved(schema: dict[str, Any], part: dict[str, Any]) -> dict[str, Any]:
    """Return a part of a schema itself where it only names another one, or is that or null."""
    if "$ref" in part:
        return _resolved(schema, schema["$defs"][part["$ref"].rpartition("/")[2]])
    given = [one for one in part.get("anyOf", ()) if one.get("type") != "null"]
    return _resolved(schema, given[0]) if given else part
