"""What an unknown name was probably meant to be."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

# Of `difflib`, from 0 to 1. At its own 0.6 a key of another unit or meaning passes for a misspelt one.
LIKENESS: Final = 0.7
MAX_NAME: Final = 100  # characters: a longer name is none of ours, and comparing takes the square of its length


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
