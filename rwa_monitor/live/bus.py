"""The Zenoh bus with secure defaults: nothing listens and nothing is searched for unless told."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal


@dataclass(frozen=True, slots=True)
class BusOptions:
    """The Zenoh options of the command line, as its users know them.

    Attributes
    ----------
    mode
        -m: peer, client or router.
    connect, listen
        -e, -l: endpoints such as "tcp/127.0.0.1:7447". Neither: embedded, the process talks to itself without a socket.
    config
        -c: a Zenoh configuration file; the other options change what it says.
    no_multicast_scouting
        Accepted because every Zenoh tool has it; scouting is off anyway unless the file turns it on.
    """

    mode: Literal["peer", "client", "router"] | None = None
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    config: Path | None = None
    no_multicast_scouting: bool = False


def open_session(options: BusOptions) -> Any:
    """Open a Zenoh session (use it with `with`); raises InputError naming the option or endpoint that does not work."""
    raise NotImplementedError
