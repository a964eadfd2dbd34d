"""Tells whether the bus is there: who hears nothing should know whether there is anybody to hear."""

from __future__ import annotations

from collections.abc import Sequence

import zenoh


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
