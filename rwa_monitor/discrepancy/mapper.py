"""How a function is applied to many candidates: in turn here; rooms that know threads and processes pass in others."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


class Mapper(Protocol):
    """Applies a function to each item and returns the values in the order of the items, in whatever order it works."""

    def __call__(
        self, function: Callable[[Item], Result], items: Iterable[Item], /, *, apart: bool = False
    ) -> list[Result]:
        """Return the function's value for each item.

        `apart` says that each is work for a process of its own: function, items and values can then be pickled.
        """
        ...


class SentOnce:
    """What many functions and items hold: where these go to other processes, it goes to each of them once, and stays.

    Equal or not, each object is one by itself there as well as here.
    """

    __slots__ = ()


def in_turn(function: Callable[[Item], Result], items: Iterable[Item], /, *, apart: bool = False) -> list[Result]:
    """Apply a function to one item after the other."""
    del apart
    return [function(item) for item in items]
