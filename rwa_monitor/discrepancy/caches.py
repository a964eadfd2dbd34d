"""What a search has worked out before and meets again, as far as there is room: columns, levels."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, Final, TypeVar

from rwa_monitor.samples import FloatArray

CACHE_BYTES: Final = 400_000_000
RECENT: Final = 4  # values that are kept: those of the models that are extended just now

Value = TypeVar("Value")


class ColumnCache:
    """Columns already evaluated, by effect and shape: the search visits the same shapes many times."""

    def __init__(self, room: int = CACHE_BYTES) -> None:
        self._columns: dict[Hashable, FloatArray] = {}
        self._room = room  # bytes

    def get(self, key: Hashable) -> FloatArray | None:
        """Return the columns, or None where they are not kept."""
        return self._columns.get(key)

    def put(self, key: Hashable, columns: FloatArray) -> None:
        """Keep columns as long as there is room; what is kept stays."""
        if columns.nbytes <= self._room:
            self._columns[key] = columns
            self._room -= columns.nbytes


class RecentCache:
    """The values asked for last, by all that decides them: many effects follow the same level."""

    def __init__(self) -> None:
        # Replaced as a whole: of two threads that add at once one may be forgotten, no more.
        self._values: tuple[tuple[tuple[object, ...], Hashable, Any], ...] = ()

    def get(self, objects: tuple[object, ...], key: Hashable, make: Callable[[], Value]) -> Value:
        """Return what `make` returned for these very objects, which are held, and this key, or what it returns now."""
        for known, of_known, kept in self._values:
            if of_known == key and all(one is other for one, other in zip(known, objects, strict=True)):
                same: Value = kept
                return same
        value = make()
        self._values = (*self._values, (objects, key, value))[-RECENT:]
        return value
