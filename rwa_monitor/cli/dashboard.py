"""`dashboard`: the health page on live and recorded diagnoses, until SIGINT or SIGTERM."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rwa_monitor.cli.options import FILE, bus_options, warn_if_alone
from rwa_monitor.cli.talk import say

if TYPE_CHECKING:
    from rwa_monitor.live.bus import BusOptions


@click.command(name="dashboard", short_help="The health page on live and recorded diagnoses.")
@click.option("--port", type=click.IntRange(0, 65535), metavar="P", help="On loopback; 0: any.  [default: 8750]")
@click.option(
    "--record",
    type=FILE,
    default=Path("recordings"),
    show_default=True,
    metavar="DIR",
    help="Folder of the recordings; the history is kept there too.",
)
@click.option("--token", envvar="RWA_MONITOR_TOKEN", metavar="T", help="Needed for changes.  [default: a random one]")
@click.option("--no-browser", is_flag=True, help="Open no browser.")
@bus_options
def command(port: int | None, record: Path, token: str | None, no_browser: bool, bus: BusOptions) -> None:
    """Serve the health page of all wheels on the bus, with what the recordings in DIR hold.

    The page can be read by everybody on this machine; the address printed holds the token that changes need.
    """
    try:
        from rwa_monitor.dashboard.server import DEFAULT_PORT, HISTORY_NAME, DashboardOptions, serve
    except ImportError as error:
        raise click.ClickException(f"{error.name} is missing: pip install 'rwa-monitor[dashboard]'") from error
    from rwa_monitor.cli.signals import stop_on_signals
    from rwa_monitor.errors import InputError
    from rwa_monitor.history.imports import import_recordings
    from rwa_monitor.history.store import History
    from rwa_monitor.live.bus import open_session

    warn_if_alone(bus)
    options = DashboardOptions(DEFAULT_PORT if port is None else port, record, token=token)
    if record.is_dir() and any(record.glob("*.mcap")):
        with History(record / HISTORY_NAME) as history:
            try:
                imported = import_recordings(history, record)
            except InputError as error:
                say(f"{error}; it is left out")
            else:
                say(f"{imported.windows} windows in the recordings, {imported.new} of them new to the history")
    with stop_on_signals() as stop, open_session(bus) as session, serve(options, session, say) as running:
        say(f"the page is at {running.address_with_token}")
        if not no_browser:
            webbrowser.open(running.address_with_token)
        stop.wait()
