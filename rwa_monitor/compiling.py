"""Tells of the compilation of kernels, which takes a minute or two, once on each machine; then they are kept on disk.

Each is compiled when it is first called, so the first use compiles most of them, and the first one of another kind
those that it needs beside.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

from numba.core import event

NOTICEABLE_S: Final = 2.0  # what compiles in less is not worth a word


class _Teller(event.Listener):
    """Adds up the time of compilations, which nest, until it is worth a word; what is loaded from disk is none."""

    def __init__(self, say: Callable[[], None], noticeable_s: float) -> None:
        self.say = say
        self.noticeable_s = noticeable_s
        self.told = False
        self.depth = 0
        self.began_s = 0.0
        self.taken_s = 0.0

    def on_start(self, event: Any) -> None:
        del event
        now_s = time.monotonic()
        if self.depth == 0:
            self.began_s = now_s
        self.depth += 1
        if not self.told and self.taken_s + now_s - self.began_s >= self.noticeable_s:
            self.told = True
            self.say()

    def on_end(self, event: Any) -> None:
        del event
        self.depth -= 1
        if self.depth == 0:
            self.taken_s += time.monotonic() - self.began_s


_tellers: Final[list[_Teller]] = []  # one at most: a process says it once


def tell_of_compiling(say: Callable[[], None], noticeable_s: float | None = None) -> None:
    """Have `say` called, once in this process, when numba has compiled for longer than this [s].

    None: for longer than `NOTICEABLE_S`. To be called where somebody is about to compute; who calls it first is the one
    who tells.
    """
    if not _tellers:
        _tellers.append(_Teller(say, NOTICEABLE_S if noticeable_s is None else noticeable_s))
        event.register("numba:compile", _tellers[0])  # type: ignore[no-untyped-call]
