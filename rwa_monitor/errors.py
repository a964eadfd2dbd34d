"""Errors that a user can act on: one clear line, its exit code, and a suggestion for an unknown name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError

MAX_PART: Final = 500  # characters of the place of an error, and of its reason
# Cutoff for `difflib`, from 0 to 1. At its default of 0.6 a key of another unit or meaning counts as a misspelt one.
LIKENESS: Final = 0.7


class RwaMonitorError(Exception):
    """Base of all errors that the command line shows as one line, without a traceback (exit code 1)."""


class MissingExtraError(RwaMonitorError):
    """A package that belongs to an extra is not installed."""


@contextmanager
def needs_extra(extra: str) -> Iterator[None]:
    """Raise MissingExtraError where an import in the block fails: the package belongs to this extra."""
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
        """Return the first error that a pydantic model found, with its field.

        An unknown key takes precedence over a missing one: it may be that one, misspelt.

        Parameters
        ----------
        source
            What was read.
        error
            What pydantic raised.
        place
            Used where the error is of no field but of the whole.
        what
            Text before the reason, such as "is no model: ".
        model
            If given, an unknown key is reported with the most similar known one.
        """
        found = error.errors(include_url=False, include_context=False)
        first = next((one for one in found if one["type"] == "extra_forbidden"), found[0])
        if first["type"] == "extra_forbidden" and model is not None:
            schema = model.model_json_schema()
            parts = (schema, *schema.get("$defs", {}).values())
            known = [name for part in parts for name in part.get("properties", ())]
            first["msg"] = f"no key has this name{did_you_mean(str(first['loc'][-1]), known)}"
        return cls(source, f"{what}{first['msg']}", ".".join(str(part) for part in first["loc"]) or place)

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str]]:
        """Keep all three parts when the error is pickled, to cross a process border."""
        return (InputError, (self.source, self.reason, self.place))


def _shortened(text: str) -> str:
    """Return a text, cut where it is long: the wrong name may have a million characters."""
    return text if len(text) <= MAX_PART else f"{text[: MAX_PART - 1]}…"


def _one_line(text: str) -> str:
    """Return a text with line breaks and other unprintable characters, as keys and names may hold them, escaped."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode("ascii") for c in text)


# ---- names that are not known ----------------------------------------------------------------------------------------


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return "; did you mean 'x'?" with the most similar known name, "" where none is similar enough.

    Parameters
    ----------
    name
        The unknown name.
    known
        All names that are allowed there.
    """
    if len(name) > MAX_PART:  # no known name is that long, and comparing takes the square of its length
        return ""
    # Imported here: it takes as long to load as everything else that --help needs.
    from difflib import get_close_matches  # noqa: PLC0415

    by_lower = {one.lower(): one for one in known}
    found = get_close_matches(name.lower(), by_lower, n=1, cutoff=LIKENESS)
    return f"; did you mean {by_lower[found[0]]!r}?" if found else ""
