"""Compares two sequences of messages: lengths, order of types, bytes, then field by field with a tolerance."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

# Same code on another machine: sums may be taken in another order by its vector units, which moves the last bits.
RELATIVE_TOLERANCE: Final = 1e-9
# A difference of large numbers can be zero but for rounding; no torque, time or probability of ours is as small.
ABSOLUTE_TOLERANCE: Final = 1e-15
# Fields that are compared by their bytes only, with the reason: a hash of floats has no tolerance.
HASHES_OF_WHAT_IS_COMPARED: Final = {
    "provenance.prior_sha256": "the state that it hashes is compared as rwa.Carried",
    "sha256": "the state beside it in rwa.Carried is compared",
}
MAX_DIFFERENCES: Final = 10_000  # listed one by one; the rest is counted


@dataclass(frozen=True, slots=True)
class Difference:
    """One field that differs: which message, where in it, and both values."""

    message: str
    path: str
    recorded: str
    replayed: str

    def __str__(self) -> str:
        """Return one line."""
        return f"{self.message}: {self.path}: recorded {self.recorded}, replayed {self.replayed}"

    @property
    def field(self) -> str:
        """The place without positions in lists, so that like differences count together."""
        parts = [part for part in self.path.split(".") if not part.isdigit()]
        return ".".join(parts)


@dataclass(slots=True)
class Comparison:
    """Result of a comparison.

    Attributes
    ----------
    compared
        Messages compared, by schema.
    differences
        Beyond the tolerance.
    bytes_equal
        Whether all compared messages have equal bytes.
    """

    compared: Counter[str] = field(default_factory=Counter)
    differences: list[Difference] = field(default_factory=list)
    bytes_equal: bool = True

    def add_all(self, other: Comparison) -> None:
        """Take in the result of another comparison."""
        self.compared += other.compared
        self.differences += other.differences[: max(0, MAX_DIFFERENCES - len(self.differences))]
        self.bytes_equal &= other.bytes_equal

    def add(self, difference: Difference) -> None:
        """Note a difference."""
        self.bytes_equal = False
        if len(self.differences) < MAX_DIFFERENCES:
            self.differences.append(difference)


Comparable = tuple[str, str, bytes]  # topic, schema, JSON


def compare(recorded: Sequence[Comparable], replayed: Sequence[Comparable]) -> Comparison:
    """Compare recorded with replayed messages, in order."""
    result = Comparison()
    if len(recorded) != len(replayed):
        result.add(Difference("all messages", "length", str(len(recorded)), str(len(replayed))))
    for position, (old, new) in enumerate(zip(recorded, replayed, strict=False)):
        name = f"{old[0]} ({position})"
        if old[:2] != new[:2]:
            result.add(Difference(name, "type", f"{old[1]} on {old[0]}", f"{new[1]} on {new[0]}"))
            break  # what follows is out of step
        result.compared[old[1]] += 1
        if old[2] == new[2]:
            continue
        result.bytes_equal = False
        for path, left, right in differences(_parse(old[2]), _parse(new[2])):
            if path not in HASHES_OF_WHAT_IS_COMPARED:
                result.add(Difference(name, path, _short(left), _short(right)))
    return result


def differences(left: Any, right: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield (path, left, right) wherever two JSON values differ by more than 1e-9 relative."""
    if _is_number(left) and _is_number(right):
        if not _close(left, right):
            yield path, left, right
    elif isinstance(left, dict) and isinstance(right, dict):
        for key in [*left, *(key for key in right if key not in left)]:
            inner = f"{path}.{key}" if path else str(key)
            if key in left and key in right:
                yield from differences(left[key], right[key], inner)
            else:
                yield inner, left.get(key, _ABSENT), right.get(key, _ABSENT)
    elif isinstance(left, list) and isinstance(right, list):
        if len(left) != len(right):
            yield f"{path}.length" if path else "length", len(left), len(right)
        for position, (one, other) in enumerate(zip(left, right, strict=False)):
            yield from differences(one, other, f"{path}.{position}" if path else str(position))
    elif type(left) is not type(right) or left != right:
        yield path, left, right


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _close(left: float, right: float) -> bool:
    if isinstance(left, int) and isinstance(right, int):
        return left == right  # counts, slots and times are exact
    return left == right or math.isclose(left, right, rel_tol=RELATIVE_TOLERANCE, abs_tol=ABSOLUTE_TOLERANCE)


def _parse(payload: bytes) -> Any:
    try:
        return json.loads(payload)
    except (ValueError, RecursionError):
        return f"no JSON: {payload[:40]!r}"


def _short(value: Any) -> str:
    text = value if isinstance(value, _Absent) else json.dumps(value, ensure_ascii=False)
    return str(text) if len(str(text)) <= 80 else f"{str(text)[:77]}..."


class _Absent:
    def __repr__(self) -> str:
        return "nothing"


_ABSENT: Final = _Absent()
