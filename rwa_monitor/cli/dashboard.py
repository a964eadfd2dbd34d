"""`dashboard`: the health page on live and recorded diagnoses, until SIGINT or SIGTERM."""

from __future__ import annotations

import functools
import os
import sys
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rwa_monitor.cli.options import FILE, Decorated, Real, Whole, bus_options, not_nan, warn_if_alone
from rwa_monitor.cli.talk import say

if TYPE_CHECKING:
    from rwa_monitor.live.bus import BusOptions


@dataclass(frozen=True, slots=True)
class AlarmOptions:
    """Who is told of alarms, and from which silence on a monitor is one [s]."""

    webhook: str | None
    silence_s: float | None


def alarm_options(command: Decorated) -> Decorated:
    """Add the options of alarms to a command; it gets them as `alarms`, `AlarmOptions`."""

    @click.option("--webhook", metavar="URL", help="Each change of an alarm is posted there, as JSON.")
    @click.option(
        "--silence",
        type=Real(min=0),
        callback=not_nan,
        metavar="S",
        help="A monitor that is not heard for so many seconds is an alarm; 0 for none.  [default: 30]",
    )
    @functools.wraps(command)
    def with_alarms(webhook: str | None, silence: float | None, **rest: Any) -> Any:
        return command(alarms=AlarmOptions(webhook, silence), **rest)

    return with_alarms  # type: ignore[return-value]


@click.command(name="dashboard", short_help="The health page on live and recorded diagnoses.")
@click.option(
    "--port", type=Whole(0, 65535), metavar="P", help="Port of the page, on loopback.  [default: 8750, or any]"
)
@click.option(
    "--record",
    type=FILE,
    default=Path("recordings"),
    show_default=True,
    metavar="DIR",
    help="Folder of the recordings; the history is kept there too.",
)
@click.option(
    "--history",
    envvar="RWA_MONITOR_HISTORY",
    metavar="URL",
    help="Database: postgresql://USER:PASSWORD@HOST/NAME.  [default: a SQLite file in DIR]",
)
@click.option(
    "--keep",
    nargs=4,
    type=Real(min=0, min_open=True),
    metavar="D F E A",
    help="Days to keep diagnoses (D), each window's estimates (F), each day's worst ones (E), closed alarms (A).  "
    "[default: 180 365 3650 3650]",
)
@alarm_options
@click.option(
    "--foxglove",
    type=Whole(0, 65535),
    metavar="PORT",
    help="Serve Foxglove live on this port, on loopback (needs rwa-monitor[foxglove]).",
)
@click.option(
    "--token",
    envvar="RWA_MONITOR_TOKEN",
    metavar="T",
    help="Who has it may acknowledge and shelve.  [default: a random one]",
)
@click.option(
    "--wheel",
    type=FILE,
    metavar="W.toml",
    help="Constants for friction from current.  [default: those of the latest recording in DIR]",
)
@click.option("--no-browser", is_flag=True, help="Open no browser.")
@bus_options
def command(
    port: int | None,
    record: Path,
    history: str | None,
    keep: tuple[float, float, float, float] | None,
    alarms: AlarmOptions,
    foxglove: int | None,
    token: str | None,
    wheel: Path | None,
    no_browser: bool,
    bus: BusOptions,
) -> None:
    """Serve the health page of all wheels on the bus, with what the recordings in DIR hold.

    The page can be read by everybody on this machine; the address printed holds the token that changes need.
    """
    try:
        from rwa_monitor.dashboard.server import DashboardOptions, serve
    except ImportError as error:
        raise click.ClickException(f"{error.name} is missing: pip install 'rwa-monitor[dashboard]'") from error
    from rwa_monitor.cli.signals import stop_on_signals
    from rwa_monitor.dashboard.monitor_watch import SILENT_S
    from rwa_monitor.errors import InputError
    from rwa_monitor.formats.wheel_file import read_wheel
    from rwa_monitor.history.imports import import_recordings
    from rwa_monitor.history.retention import Retention
    from rwa_monitor.history.store import History
    from rwa_monitor.live.bus import endpoints, open_session

    try:
        retention = Retention(*keep) if keep else None
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--keep") from error
    warn_if_alone(bus)
    options = DashboardOptions(
        port,
        record,
        token=token,
        wheel=read_wheel(wheel) if wheel else None,
        connect=endpoints(bus),
        history=history,
        retention=retention,
        webhook=alarms.webhook,
        silent_s=SILENT_S if alarms.silence_s is None else alarms.silence_s,
        foxglove=foxglove,
    )
    if record.is_dir() and any(record.glob("*.mcap")):
        with History(options.history_place, retention=retention) as kept:
            try:
                imported = import_recordings(kept, record)
            except InputError as error:
                say(f"{error}; it is left out")
            else:
                say(f"{imported.windows} windows in the recordings, {imported.new} of them new to the history")
    elif not record.is_dir():
        say(f"there is no folder {record} yet; it is made for the history")
    with stop_on_signals() as stop, open_session(bus) as session, serve(options, session, say) as running:
        show_page(running.address_with_token, no_browser=no_browser)
        stop.wait()


def show_page(address: str, *, no_browser: bool) -> None:
    """Say where the page is, and open it where a person sits before a screen."""
    say(f"the page is at {address}")
    has_screen = sys.platform == "darwin" or "DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ
    if not no_browser and has_screen and sys.stderr.isatty():
        webbrowser.open(address)
