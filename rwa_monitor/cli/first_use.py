"""Says so when kernels are compiled, which takes up to a minute, once on each machine; then they are kept on disk.

Each is compiled when it is first called, so the first command compiles most of them, and the first one of another kind
those that it needs beside.
"""

from __future__ import annotations

import time
from typing import Any, Final

from rwa_monitor.cli.talk import say

MESSAGE: Final = "compiling what this command needs, once on this machine: this takes up to a minute"
NOTICEABLE_S: Final = 2.0  # what compiles in less is not worth a word


def tell_of_compiling(noticeable_s: float = NOTICEABLE_S) -> None:
    """Say so, once, when numba compiles for longer than this; to be called where a command is about to compute."""
    from numba.core import event

    class Teller(event.Listener):
        """Adds up the time of compilations, which nest, until it is worth a word; what is loaded from disk is none."""

        told = False
        depth = 0
        began_s = 0.0
        taken_s = 0.0

        def on_start(self, event: Any) -> None:
            del event
            now_s = time.monotonic()
            if self.depth == 0:
                self.began_s = now_s
            self.depth += 1
            if not self.told and self.taken_s + now_s - self.began_s >= noticeable_s:
                self.told = True
                say(MESSAGE)

        def on_end(self, event: Any) -> None:
            del event
            self.depth -= 1
            if self.depth == 0:
                self.taken_s += time.monotonic() - self.began_s

    event.register("numba:compile", Teller())  # type: ignore[no-untyped-call]
