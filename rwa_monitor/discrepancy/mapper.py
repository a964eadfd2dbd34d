"""How a function is applied to many candidates: in turn here; rooms that may start threads pass in others."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


class Mapper(Protocol):
    """Applies a function to each item and returns the values in the order of the items, in whatever order it works."""

    def __call__(self, function: Callable[[Item], Result], items: Iterable[Item], /) -> list[Result]:
        """Return the function's value for each item."""
        ...


def in_turn(function: Callable[[Item], Result], items: Iterable[Item], /) -> list[Result]:
    """Apply a function to one item after the other."""
    return [function(item) for item in items]
