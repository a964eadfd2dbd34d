"""TOML that somebody else wrote: its size and the depth of its keys are limited before it is parsed."""

from __future__ import annotations

import re
import tomllib
from typing import Any, Final

from pydantic import BaseModel, ConfigDict

from rwa_monitor.errors import InputError

MAX_KEY_PARTS: Final = 16  # of a.b.c; ours have two, and Python's parser takes a time that grows with their square
_PART: Final = r"""(?:(?<![\w-])[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_LONG_KEY: Final = re.compile(rf"(?:{_PART}[ \t]*+\.[ \t]*+){{{MAX_KEY_PARTS}}}")


class Strict(BaseModel):
    """Base of the content of a file: frozen, no key that is not known, no number that is not finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def parse_toml(text: str, source: str, limit: int, what: str) -> dict[str, Any]:
    """Return the tables of a TOML text.

    Parameters
    ----------
    text
        The file's content.
    source
        Its name, for messages.
    limit
        Characters from which it is refused.
    what
        What it should be, for messages: "a wheel file".

    Raises
    ------
    InputError
        If it is too large, its keys are too deep, or it is no TOML.
    """
    if len(text) > limit:
        raise InputError(source, f"is larger than {limit} bytes; this is not {what}")
    if _LONG_KEY.search(text):
        raise InputError(source, f"has a key of more than {MAX_KEY_PARTS} parts; this is not {what}")
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(source, f"is no valid TOML: {error}") from error
