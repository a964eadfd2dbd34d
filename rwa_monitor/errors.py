"""Errors that a user can act on: one clear line, and the exit code that goes with it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rwa_monitor.hints import alternatives_at, did_you_mean, keys_at

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError

MAX_PART: Final = 500  # characters of the place of an error, and of its reason


class RwaMonitorError(Exception):
    """Base of all errors that the command line shows as one line, without a traceback (exit code 1)."""


class MissingExtraError(RwaMonitorError):
    """A package that belongs to an extra is not installed."""


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
