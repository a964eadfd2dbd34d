"""Options that several commands share, each written once."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click

from rwa_monitor.cli.talk import say

if TYPE_CHECKING:
    from rwa_monitor.live.bus import BusOptions

# Endpoints that nobody reaches from outside this machine, and transports whose other end shows who it is.
_LOOPBACK: Final = re.compile(r"127\.|localhost:|\[::1\]")
_PROTECTED: Final = ("tls", "quic", "unixsock-stream", "unixpipe")

BYTES_PER_GB: Final = 1e9

Decorated = TypeVar("Decorated", bound=Callable[..., Any])

# Whether a file exists and can be used is said by whoever reads it, with the reason; click only makes it a Path.
FILE: Final = click.Path(path_type=Path)


class Whole(click.IntRange):
    """A whole number in a range; click's own name for it, "integer range", stands in messages to people."""

    name = "whole number"


class Real(click.FloatRange):
    """A number in a range; NaN lies in none, see `not_nan`."""

    name = "number"


def not_nan(ctx: click.Context, param: click.Parameter, value: float | None) -> float | None:
    """Refuse NaN, which lies in no range and outside of none; a callback for options with a number."""
    del ctx, param
    if value is not None and math.isnan(value):
        raise click.BadParameter("nan is no number here")
    return value


speed_option = click.option(
    "--speed",
    type=Real(0, min_open=True),
    callback=not_nan,
    default=1.0,
    show_default=True,
    metavar="X",
    help="Times real time when publishing; inf: as fast as it goes.",
)
wheel_option = click.option(
    "--wheel", "wheel_file", type=FILE, metavar="W.toml", help="Constants of the wheel.  [default: the built-in wheel]"
)
model_option = click.option(
    "--model", "model_file", type=FILE, metavar="M.json", help="Trained classifiers.  [default: the built-in model]"
)
motor_off_option = click.option(
    "--motor-off",
    is_flag=True,
    help="The wheel runs down with its motor off: friction is -J dω/dt, speed and inertia_kg_m2 are enough.",
)
method_option = click.option(
    "--method",
    type=click.Choice(["joint", "paper"]),
    default="joint",
    show_default=True,
    help="Assign jumps jointly, or as printed in the paper.",
)


def udp_option(*, required: bool, help: str) -> Callable[[Decorated], Decorated]:  # noqa: A002 - as click names it
    """Return the option for an address of datagrams; the command gets it as `udp`."""
    return click.option("--udp", required=required, metavar="[HOST:]PORT", help=help)


def decoding_options(command: Decorated) -> Decorated:
    """Add what packets and bags are read with; the command gets it as `decoding`, a `formats.telemetry.Decoding`."""

    @click.option(
        "--map",
        "map_file",
        type=FILE,
        metavar="MAP.toml",
        help="For space packets and ROS 2 bags: which parameter or topic is which channel.",
    )
    @click.option("--xtce", "xtce_file", type=FILE, metavar="X.xml", help="For space packets: what is in them.")
    @functools.wraps(command)
    def with_decoding(map_file: Path | None, xtce_file: Path | None, **rest: Any) -> Any:
        from rwa_monitor.formats.telemetry import read_decoding

        return command(decoding=read_decoding(map_file, xtce_file), **rest)

    return with_decoding  # type: ignore[return-value]


scheduler_option = click.option(
    "--scheduler", metavar="ADDR", help="Work on this Dask cluster, such as tcp://host:8786.  [default: this machine]"
)
workers_option = click.option(
    "--workers", type=Whole(1, 1024), metavar="N", help="Processes on this machine.  [default: cores]"
)


@dataclass(frozen=True, slots=True)
class FleetOptions:
    """How thousands of recordings are worked off: where results go, and on which processes."""

    results: Path | None
    scheduler: str | None
    workers: int | None

    @property
    def asked_for(self) -> bool:
        """Whether any of the options was given."""
        return self.results is not None or self.scheduler is not None or self.workers is not None


def fleet_options(command: Decorated) -> Decorated:
    """Add the options of work on many recordings to a command; it gets them as `fleet`, `FleetOptions`."""

    @click.option(
        "--results",
        type=FILE,
        metavar="DIR",
        help="Keep one Parquet file for each recording there, and do again only what is not done.",
    )
    @scheduler_option
    @workers_option
    @functools.wraps(command)
    def with_fleet(results: Path | None, scheduler: str | None, workers: int | None, **rest: Any) -> Any:
        if scheduler is not None and workers is not None:
            raise click.UsageError("--workers is for this machine; the cluster of --scheduler has its own")
        return command(fleet=FleetOptions(results, scheduler, workers), **rest)

    return with_fleet  # type: ignore[return-value]


def bus_options(command: Decorated) -> Decorated:
    """Add the Zenoh options to a command; it gets them as `bus`, a `rwa_monitor.live.bus.BusOptions`."""

    @click.option("-m", "--mode", type=click.Choice(["peer", "client", "router"]), help="Role in the Zenoh network.")
    @click.option(
        "-e", "--connect", multiple=True, metavar="ENDPOINT", help="Connect there, such as tcp/HOST:7447 (repeatable)."
    )
    @click.option(
        "-l",
        "--listen",
        multiple=True,
        metavar="ENDPOINT",
        help="Listen there, such as tcp/127.0.0.1:7447 (repeatable).",
    )
    @click.option("-c", "--config", type=FILE, metavar="FILE", help="Zenoh configuration (JSON5), as for TLS.")
    @click.option(
        "--no-multicast-scouting",
        is_flag=True,
        help="Do not look for others by multicast: so it is anyway, unless -c says otherwise.",
    )
    @functools.wraps(command)
    def with_bus(
        mode: Any,
        connect: tuple[str, ...],
        listen: tuple[str, ...],
        config: Path | None,
        no_multicast_scouting: bool,
        **rest: Any,
    ) -> Any:
        """Call the command with the options as one."""
        from rwa_monitor.live.bus import BusOptions

        return command(bus=BusOptions(mode, connect, listen, config, no_multicast_scouting), **rest)

    return with_bus  # type: ignore[return-value]


def warn_if_alone(bus: BusOptions) -> None:
    """Say on stderr what the options mean for who is on the bus: nobody else, or everybody on the network."""
    if not (bus.connect or bus.listen or bus.config):
        say("without -e, -l or -c the bus is this process alone; for example -l tcp/127.0.0.1:7447, and -e elsewhere")
    for endpoint in bus.listen:
        protocol, _, address = endpoint.partition("/")
        if not address:  # no endpoint: it is refused when the bus is opened, and nobody is let in
            continue
        if protocol not in _PROTECTED and not _LOOPBACK.match(address):
            say(f"{endpoint} lets in everybody who reaches it; docker/client.json5 shows how to join by mutual TLS")
