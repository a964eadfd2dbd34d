"""`demo`: the main job in one process, on an embedded bus: simulated satellite, monitor, recording, live view.

The monitor is that of `run`, and gets its data from the bus only. The view shows only what the monitor publishes there.
The truth of the simulated satellite is printed at the end.
"""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from shlex import quote
from threading import Event
from typing import TYPE_CHECKING, Final

import click

from rwa_monitor.cli import options as cli
from rwa_monitor.errors import MissingExtraError, needs_extra

if TYPE_CHECKING:
    import zenoh

    from rwa_monitor.messages import Diagnosis, Discrepancy
    from rwa_monitor.simulation.demo_satellite import Satellite

MAX_DURATION_S: Final = 3600.0  # an hour has half a month of four wheels, all of it simulated before the start
TEMPLATE: Final = Path(__file__).with_suffix(".txt")  # of the report at the end
SEARCH_PATIENCE_S: Final = 600.0  # how long to wait for a requested search at the end: others may be before it


@click.command(short_help="The main job on simulated wheels, one of them failing.")
@cli.option("--duration", cli.Real(1.0, MAX_DURATION_S), "S", "How long the satellite sends [s].", default=90.0)
@cli.no_browser_option
@cli.port_option
@cli.option("--seed", cli.Whole(min=0), "N", "Seed of the satellite: another one hides another effect.", default=1)
@cli.record_option
@cli.bus_options
def demo(duration: float, no_browser: bool, port: int | None, seed: int, record: Path, bus: cli.BusOptions) -> None:
    """Show the main job on a simulated satellite: four wheels, one of which begins to fail.

    Another one has an effect that the monitor's wheel file lacks; the monitor finds out which. Telemetry flows some 300
    times faster than real time over a bus inside this process; the monitor diagnoses each window as it closes and
    records everything. At the end the truth is printed. Ctrl-C ends it earlier. With -l, -e or -c others can subscribe
    too. The page ends with it; rwa-monitor dashboard shows it again.
    """
    from rwa_monitor.diagnosis.model import built_in_model
    from rwa_monitor.monitor.bus import open_session, send
    from rwa_monitor.monitor.service import RunOptions, run
    from rwa_monitor.monitor.setup import Setup
    from rwa_monitor.simulation.demo_satellite import simulate_satellite

    # A new name each time: the states that the folder holds of an earlier satellite must not be carried over.
    spacecraft = time.strftime("demo-%Y%m%dT%H%M%S", time.gmtime())
    satellite = simulate_satellite(spacecraft, duration, start_ns=time.time_ns(), seed=seed)
    options = RunOptions(
        wheels=f"rwa/{spacecraft}/*/samples",
        setup=Setup(satellite.wheel, model=built_in_model()),
        record=record,
        log_verdicts=False,  # the view has a line for each window
    )
    with (
        cli.stop_on_signals() as stop,
        open_session(bus) as session,
        ExitStack() as page,
        ThreadPoolExecutor(2) as workers,
    ):
        cli.log(f"four simulated wheels, {satellite.speed:.0f} times faster than real time; recording in {record}")
        served = _serve_page(page, session, record, port, satellite, no_browser=no_browser)
        view = DemoView(session, satellite, spacecraft)
        ended = Event()
        monitor = workers.submit(run, options, ended, session=session, log=cli.log)
        sender = workers.submit(send, session, satellite.telemetry, speed=satellite.speed, stop=ended)
        monitor.add_done_callback(lambda _: stop.set())
        sender.add_done_callback(lambda worker: stop.set() if worker.exception() else None)
        try:
            view.show_until(stop, duration)
        finally:
            ended.set()
        sender.result()
        monitor.result()
    click.echo(_report(satellite, view, record, served=served), nl=False)


def _serve_page(
    page: ExitStack, session: zenoh.Session, record: Path, port: int | None, satellite: Satellite, *, no_browser: bool
) -> bool:
    """Serve the health page while the demo runs; returns whether the packages for it are installed."""
    try:
        with needs_extra("dashboard"):
            from rwa_monitor.dashboard.server import DashboardOptions, serve
    except MissingExtraError as error:
        cli.log(f"no page: {error}")
        return False
    from rwa_monitor.cli.dashboard import show_page

    # The end of the demo is no failure of the monitor: the history, shown later, must have no alarm of its silence.
    options = DashboardOptions(port, record, wheel=satellite.wheel, silent_s=0.0)
    running = page.enter_context(serve(options, session, cli.log))
    show_page(running.address_with_token, no_browser=no_browser)
    return True


# ---- while it runs ---------------------------------------------------------------------------------------------------


class DemoView:
    """Subscribes to the bus, keeps each wheel's results with their times [s], and prints a line for each diagnosis.

    Parameters
    ----------
    session
        The Zenoh session.
    satellite
        The satellite whose wheels are shown.
    spacecraft
        Its name on the bus.

    Attributes
    ----------
    diagnoses, found
        By wheel: all diagnoses in order, and the result of the search for a missing effect; each as a pair with its
        time since the start of the demo [s].
    """

    def __init__(self, session: zenoh.Session, satellite: Satellite, spacecraft: str) -> None:
        from rwa_monitor.monitor.backfill import Inbox

        self.diagnoses: defaultdict[str, list[tuple[float, Diagnosis]]] = defaultdict(list)
        self.found: dict[str, tuple[float, Discrepancy]] = {}
        self.spacecraft = spacecraft
        self._satellite = satellite
        self._began_s = time.monotonic()
        self._inbox = Inbox()
        self._subscriber = session.declare_subscriber(f"rwa/{spacecraft}/*/*", self._inbox.receive)

    def show_until(self, done: Event, seconds: float) -> None:
        """Print diagnoses until `done` is set or the time is over; while a search is pending, somewhat longer."""
        from rwa_monitor.monitor.bus import IDLE_WAIT_S

        end = time.monotonic() + seconds
        while not done.wait(IDLE_WAIT_S) and time.monotonic() < end + (SEARCH_PATIENCE_S if self._searching() else 0):
            self._take_messages()
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]
        self._take_messages()

    def searched(self, wheel: str) -> bool:
        """Return whether the model of a wheel did not fit in as many windows in a row as trigger a search."""
        from rwa_monitor.monitor.searches import PATIENCE

        misfits = "".join("-+"[diagnosis.model_adequate] for _, diagnosis in self.diagnoses[wheel])
        return "-" * PATIENCE in misfits

    def _searching(self) -> bool:
        return any(self.searched(wheel) and wheel not in self.found for wheel in self.diagnoses)

    def verdicts(self, wheel: str) -> list[str]:
        """Return the verdicts on a wheel's windows, in order."""
        return [diagnosis.verdict for _, diagnosis in self.diagnoses[wheel]]

    def _take_messages(self) -> None:
        from rwa_monitor.messages import Diagnosis, Discrepancy

        while (message := self._inbox.take()) is not None:
            _, _, wheel, kind = message.key.split("/")
            elapsed_s = time.monotonic() - self._began_s
            if kind == Discrepancy.kind:
                self.found[wheel] = elapsed_s, Discrepancy.parse(message.payload, message.key)
            elif kind == Diagnosis.kind:
                new = Diagnosis.parse(message.payload, message.key)
                self.diagnoses[wheel].append((elapsed_s, new))
                hours = self.hours(new.window_end_ns)
                click.echo(f"{elapsed_s:6.1f} s  {wheel}  {hours:5.1f} h  {new.verdict:12}  {new.reason}")

    def hours(self, time_ns: int) -> float:
        """Return a time of the wheels' clock as hours since the demo's first sample."""
        from rwa_monitor.samples import NANOSECONDS_PER_SECOND, SECONDS_PER_HOUR

        return (time_ns - self._satellite.start_ns) / NANOSECONDS_PER_SECOND / SECONDS_PER_HOUR


# ---- at the end ------------------------------------------------------------------------------------------------------


def _counts(verdicts: Iterable[str]) -> str:
    return ", ".join(f"{count} {verdict}" for verdict, count in Counter(verdicts).items())


def _report(satellite: Satellite, view: DemoView, record: Path, *, served: bool) -> str:
    """Return the report: results, truth, and how to see them again."""
    import jinja2

    import rwa_monitor as rwa
    from rwa_monitor.simulation import demo_satellite
    from rwa_monitor.words import counted

    again: list[str] = []  # verdicts with the extended wheel file, for the wheel with a hidden effect
    for extended in record.glob(f"discrepancy/{view.spacecraft}/{satellite.hiding}/extended_wheel.toml"):
        diagnoses = rwa.diagnose(satellite.hidden.samples, rwa.read_wheel(extended))
        again = [diagnosis.verdict for diagnosis in diagnoses if not diagnosis.partial]
    template = jinja2.Environment(trim_blocks=True, lstrip_blocks=True, autoescape=False).from_string(  # noqa: S701
        TEMPLATE.read_text(encoding="utf-8")
    )
    return template.render(
        satellite=satellite,
        view=view,
        record=record,
        quoted=quote(str(record)),
        served=served,
        again=again[: len(view.verdicts(satellite.hiding))],
        counted=counted,
        counts=_counts,
        demo=demo_satellite,
    )
