"""Tells whether the bus is there: who hears nothing should know whether there is anybody to hear."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import zenoh

LOOK_PERIOD_S: Final = 1.0  # between two looks at the connections


class BusWatch:
    """Looks at the connections of a session that was told to connect somewhere.

    Parameters
    ----------
    session
        An open session.
    connect
        Endpoints that it was told to connect to; a session that only listens, or is embedded, must reach nobody.
    """

    def __init__(self, session: zenoh.Session, connect: Sequence[str]) -> None:
        self._session = session
        self._where = connect

    def trouble(self) -> str:
        """Return in words what is wrong, "" where nothing is."""
        if not self._where:
            return ""
        try:
            info = self._session.info
            connected = any((*info.routers_zid(), *info.peers_zid()))
        except zenoh.ZError as error:
            return f"The bus is gone: {error}."
        where = " or ".join(self._where)
        return "" if connected else f"The bus is gone: there is no connection to {where}. Trying again."


class BusNews:
    """Says once that the bus is gone, and once that it is there again.

    Parameters
    ----------
    watch
        Looks at the connections.
    say
        Takes a line of talk.
    """

    def __init__(self, watch: BusWatch, say: Callable[[str], None]) -> None:
        self._watch, self._say = watch, say
        self._told = ""
        self._due_s = 0.0

    def look(self, now_s: float) -> None:
        """Look whether it is time to, and say what changed."""
        if now_s < self._due_s:
            return
        self._due_s = now_s + LOOK_PERIOD_S
        trouble = self._watch.trouble()
        if trouble != self._told:
            self._say(trouble or "connected to the bus again")
        self._told = trouble
