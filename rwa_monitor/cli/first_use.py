"""Says so when kernels are compiled, which takes a minute or two, once on each machine."""

from __future__ import annotations

from typing import Final

from rwa_monitor.cli.talk import say

MESSAGE: Final = "compiling what this command needs, once on this machine: this takes a minute or two"


def tell_of_compiling(noticeable_s: float | None = None) -> None:
    """Say so, once, when numba compiles for longer than this; to be called where a command is about to compute."""
    from rwa_monitor import compiling

    compiling.tell_of_compiling(lambda: say(MESSAGE), noticeable_s)
