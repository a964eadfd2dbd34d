"""`dashboard`: the health page on live and recorded diagnoses, until SIGINT or SIGTERM."""

from __future__ import annotations

import os
import sys
import webbrowser
from pathlib import Path
from typing import Any

import click

from rwa_monitor.cli import options as cli
from rwa_monitor.errors import InputError, needs_extra


@click.command(short_help="The health page on live and recorded diagnoses.")
@cli.port_option
@cli.record_option
@cli.option("--history", str, "URL", "Database: postgresql://USER:PASSWORD@HOST/NAME.  [default: a SQLite file in DIR]")
@cli.option(
    "--silence",
    cli.Real(min=0),
    "S",
    "A monitor that has been silent for so many seconds is an alarm; 0 for none.",
    default=30.0,
)
@cli.option(
    "--foxglove",
    cli.Whole(0, 65535),
    "PORT",
    "Serve Foxglove live on this port, on loopback (needs rwa-monitor[foxglove]).",
)
@cli.option(
    "--allow-origin", str, "ORIGIN", "Pages of this origin, such as Open MCT's http://127.0.0.1:8080, may read."
)
@cli.option("--token", str, "T", "Who has it may acknowledge and shelve.  [default: a random one]")
@cli.option(
    "--wheel",
    cli.FILE,
    "W.toml",
    "Constants for friction from current.  [default: those of the latest recording in DIR]",
)
@cli.no_browser_option
@cli.bus_options
def dashboard(
    record: Path,
    wheel: Path | None,
    silence: float,
    no_browser: bool,
    bus: cli.BusOptions,
    **page: Any,
) -> None:
    """Serve the health page of all wheels on the bus, with what the recordings in DIR hold.

    The page can be read by everybody on this machine; the address printed holds the token that changes need.
    """
    with needs_extra("dashboard"):
        from rwa_monitor.dashboard.server import DashboardOptions, serve
    from rwa_monitor.dashboard.recordings import import_recordings
    from rwa_monitor.history.store import History
    from rwa_monitor.messages import PERIOD_S
    from rwa_monitor.monitor.setup import read_wheel

    options = DashboardOptions(
        record=record,
        wheel=read_wheel(wheel) if wheel else None,
        bus=bus,
        silent_s=silence,
        **page,
    )
    if record.is_dir() and any(record.glob("*.mcap")):
        with History(options.history_place) as kept:
            try:
                windows, new = import_recordings(kept, record)
            except InputError as error:
                cli.log(f"{error}; it is left out")
            else:
                cli.log(f"{windows} windows in the recordings, {new} of them new to the history")
    elif not record.is_dir():
        cli.log(f"there is no folder {record} yet; it is made for the history")
    with cli.on_bus(bus) as (stop, session), serve(options, session, cli.log) as running:
        show_page(running.address_with_token, no_browser=no_browser)
        while not stop.wait(PERIOD_S):  # a signal just before a wait takes effect after it
            pass


def show_page(address: str, *, no_browser: bool) -> None:
    """Log the page's address, and open it in a browser if there is a screen and a terminal."""
    cli.log(f"the page is at {address}")
    has_screen = sys.platform == "darwin" or "DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ
    if not no_browser and has_screen and sys.stderr.isatty():
        webbrowser.open(address)
