"""Canonical JSON: one text for one meaning, so that what is hashed, recorded and compared is the same everywhere.

Floats that go into a file keep 12 significant digits: more than any friction is known to, and few enough that the last
bits, in which machines differ, never show.
"""

from __future__ import annotations

import hashlib
import json
from typing import Annotated, Any, Final

from pydantic import AfterValidator

SIGNIFICANT_DIGITS: Final = 12


def rounded(value: float) -> float:
    """Return a value at 12 significant digits; applying it twice changes nothing."""
    return float(f"{value:.{SIGNIFICANT_DIGITS}g}")


# The type of a float that is kept in a file.
Rounded = Annotated[float, AfterValidator(rounded)]


def canonical_json(content: Any) -> str:
    """Write plain content (dicts, lists, numbers, text) with sorted keys and without spaces.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)


def content_sha256(content: Any) -> str:
    """Return the hash of the canonical JSON of plain content."""
    return hashlib.sha256(canonical_json(content).encode()).hexdigest()
