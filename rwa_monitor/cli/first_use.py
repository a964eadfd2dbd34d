"""Says so when kernels are compiled, which takes up to a minute, once on each machine; then they are kept on disk."""

from __future__ import annotations

from typing import Any, Final

from rwa_monitor.cli.talk import say

MESSAGE: Final = "compiling for this machine, once: this takes up to a minute"


def tell_of_compiling() -> None:
    """Say so, once, when numba begins to compile; to be called where a command is about to compute."""
    from numba.core import event

    class Teller(event.Listener):
        """Speaks at the first compilation; what is loaded from the disk is none."""

        told = False

        def on_start(self, event: Any) -> None:
            del event
            if not self.told:
                self.told = True
                say(MESSAGE)

        def on_end(self, event: Any) -> None:
            del event

    event.register("numba:compile", Teller())  # type: ignore[no-untyped-call]
