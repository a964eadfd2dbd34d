"""`demo`: the main job in one process, on an embedded bus: simulated satellite, monitor, recording, live view.

The monitor is the one of `run`, and gets nothing but the bus. Who knows the truth is the story, which tells it at the
end.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from shlex import quote
from threading import Event
from typing import TYPE_CHECKING, Final

import click

from rwa_monitor.cli.options import FILE, Real, Whole, bus_options, not_nan
from rwa_monitor.cli.talk import say

if TYPE_CHECKING:
    import zenoh

    from rwa_monitor.cli.demo_story import Story
    from rwa_monitor.cli.demo_view import DemoView
    from rwa_monitor.live.bus import BusOptions

DEFAULT_DURATION_S: Final = 90.0
MAX_DURATION_S: Final = 3600.0  # an hour simulates half a month of four wheels; it is all made before it begins
DEFAULT_SEED: Final = 1
BATCH_SAMPLES: Final = 256
SEARCH_PATIENCE_S: Final = 600.0  # how long a search that has begun may still take at the end: others go before it


@click.command(name="demo", short_help="The main job on simulated wheels, one of them failing.")
@click.option(
    "--duration",
    type=Real(1.0, MAX_DURATION_S),
    callback=not_nan,
    default=DEFAULT_DURATION_S,
    show_default=True,
    metavar="S",
    help="How long the satellite sends [s].",
)
@click.option("--no-browser", is_flag=True, help="Open no browser.")
@click.option("--port", type=Whole(0, 65535), metavar="P", help="Port of the page.  [default: 8750, or any]")
@click.option(
    "--seed",
    type=Whole(min=0),
    default=DEFAULT_SEED,
    show_default=True,
    metavar="N",
    help="Seed of the satellite: another one hides another effect.",
)
@click.option(
    "--record",
    type=FILE,
    default=Path("recordings"),
    show_default=True,
    metavar="DIR",
    help="Folder of the recordings.",
)
@bus_options
def command(duration: float, no_browser: bool, port: int | None, seed: int, record: Path, bus: BusOptions) -> None:
    """Show the main job on a simulated satellite: four wheels, one of which begins to fail.

    Another one has an effect that the monitor's wheel file lacks; the monitor finds out which. Telemetry flows some 300
    times faster than real time over a bus inside this process; the monitor diagnoses each window as it closes and
    records everything. At the end the truth is told. Ctrl-C ends it earlier. With -l, -e or -c others can listen too.
    The page ends with it; rwa-monitor dashboard shows it again.
    """
    from rwa_monitor.cli.demo_story import tell
    from rwa_monitor.cli.demo_view import DemoView
    from rwa_monitor.cli.signals import stop_on_signals
    from rwa_monitor.diagnosis.model import built_in_model
    from rwa_monitor.live.bus import open_session
    from rwa_monitor.live.publisher import publish
    from rwa_monitor.live.run_options import RunOptions
    from rwa_monitor.live.service import run

    # A new satellite each time: what the folder holds of the last one is not carried over to this one's healthy wheels.
    spacecraft = time.strftime("demo-%Y%m%dT%H%M%S", time.gmtime())
    story = tell(spacecraft, duration, start_ns=time.time_ns(), seed=seed)
    options = RunOptions(
        wheels=f"rwa/{spacecraft}/*/samples",
        wheel=story.wheel,
        model=built_in_model(),
        record=record,
        tell_verdicts=False,  # the view has a line for each window
    )
    with (
        stop_on_signals() as stop,
        open_session(bus) as session,
        ExitStack() as page,
        ThreadPoolExecutor(2) as workers,
    ):
        say(f"four simulated wheels, {story.speed:.0f} times faster than real time; recording in {record}")
        served = _serve_page(page, session, record, port, story, no_browser=no_browser)
        view = DemoView(session, spacecraft, story.start_ns)
        ended = Event()
        monitor = workers.submit(run, options, ended, session=session, say=say)
        satellite = workers.submit(
            publish, story.telemetry, session, speed=story.speed, batch_samples=BATCH_SAMPLES, stop=ended
        )
        monitor.add_done_callback(lambda _: stop.set())
        satellite.add_done_callback(lambda worker: stop.set() if worker.exception() else None)
        try:
            view.show_until(stop, duration, SEARCH_PATIENCE_S)
        finally:
            ended.set()
        satellite.result()
        monitor.result()
        view.close()
    _tell_findings(story, view, record)
    _tell_the_truth(story, view, record)
    if served:
        click.echo(
            f"The page ended with the demo. To see it again: rwa-monitor dashboard --record {quote(str(record))}"
        )


def _serve_page(
    page: ExitStack, session: zenoh.Session, record: Path, port: int | None, story: Story, *, no_browser: bool
) -> bool:
    """Serve the health page while the demo runs; returns whether what it needs is installed."""
    try:
        from rwa_monitor.dashboard.server import DashboardOptions, serve
    except ImportError as error:
        say(f"no page: {error.name} is missing (pip install 'rwa-monitor[dashboard]')")
        return False
    from rwa_monitor.cli.dashboard import show_page

    # The demo's end is no monitor's death: who looks at its recording later must not be told of one.
    options = DashboardOptions(port, record, wheel=story.wheel, silent_s=0.0)
    running = page.enter_context(serve(options, session, say))
    show_page(running.address_with_token, no_browser=no_browser)
    return True


def _tell_findings(story: Story, view: DemoView, record: Path) -> None:
    """Print what the searches found missing in the wheels' model, what that gains, and where it is written."""
    found_in = {wheel: row.discrepancy for wheel, row in sorted(view.rows.items()) if row.discrepancy is not None}
    for wheel, found in found_in.items():
        click.echo(f"\nWhat the monitor found in {wheel}, {view.rows[wheel].discrepancy_s:.0f} s into the demo:")
        for effect in found.effects:
            others = (
                f", or, as well as these data can tell, {', '.join(effect.equivalent)}" if effect.equivalent else ""
            )
            click.echo(f"  missing in its model: {effect.name}{others}")
            for name, value in effect.parameters.items():
                spread = f" ± {value.std:.1g}" if value.std is not None else ""
                click.echo(f"    {name} = {value.value:.4g}{spread}")
        if found.unexplained is not None:
            click.echo(f"  left unexplained: {found.unexplained.signature}")
        if found.gain is not None and found.effects:
            gain = found.gain
            rmse = f"{gain.rmse_base_Nm * 1e6:.2f} → {gain.rmse_extended_Nm * 1e6:.2f} µN m"
            score = f"{gain.log_score_base:.4f} → {gain.log_score_extended:.4f} a sample"
            jumps = f"{gain.changepoints_base} → {gain.changepoints_extended}"
            click.echo(f"  gain on held-out blocks: RMSE {rmse}, log score {score}; jumps of the friction {jumps}")
        folder = record / "discrepancy" / found.spacecraft / wheel
        if wheel == story.hiding and (folder / "extended_wheel.toml").exists():
            before, after = view.rows[wheel].diagnoses, _diagnose_again(story, folder / "extended_wheel.toml")
            click.echo(f"  its windows as they were diagnosed: {_verdict_counts(d.verdict for d in before)}")
            click.echo(f"  and once more, with the model extended: {_verdict_counts(after[: len(before)])}")
        click.echo(f"  report: {folder / 'report.html'}\n  extended model: {folder / 'extended_wheel.toml'}")
    if story.hiding not in found_in:
        row = view.rows.get(story.hiding)
        searched = row is not None and row.searched
        what = "the search for it had an answer" if searched else "two windows in a row had shown it"
        click.echo(
            f"\nThe model of {story.hiding} lacks an effect. The demo ended before {what};"
            " a longer --duration gives it time."
        )


def _diagnose_again(story: Story, extended: Path) -> list[str]:
    """Return the verdicts on the full windows of the wheel that hides an effect, with its extended model."""
    from rwa_monitor.diagnosis.model import built_in_model
    from rwa_monitor.live.core import diagnose_samples
    from rwa_monitor.physics.wheel import Wheel

    wheel = Wheel.from_toml(extended.read_text(encoding="utf-8"), str(extended))
    samples = story.hidden.samples
    windows = diagnose_samples(samples, wheel, built_in_model())
    return [window.diagnosis.verdict for window in windows if not window.partial]


def _verdict_counts(verdicts: Iterable[str]) -> str:
    return ", ".join(f"{count} {verdict}" for verdict, count in Counter(verdicts).items())


def _tell_the_truth(story: Story, view: DemoView, record: Path) -> None:
    """Print what happened, what the monitor said of it, and how to check the recording."""
    from rwa_monitor.cli.demo_story import ANOMALY, FACTOR, FAILING
    from rwa_monitor.words import counted

    click.echo(
        f"\nWhat was true: the {ANOMALY} friction of {FAILING} grew to {FACTOR} times its nominal value"
        f" from {view.hours(story.onset_ns):.1f} h on; the other wheels were healthy."
    )
    effect = story.hidden.effect
    values = ", ".join(f"{name} = {value:.4g}" for name, value in effect.parameters.items())
    click.echo(
        f"{story.hiding} has {effect.name} ({values}), which the monitor's wheel file lacks: {story.hidden.sigmas:.1f}"
        " standard deviations of the noise beyond what dry and viscous friction can take up."
    )
    for wheel, row in sorted(view.rows.items()):
        said = _verdict_counts(diagnosis.verdict for diagnosis in row.diagnoses) or "no window was full yet"
        click.echo(f"  {wheel}  {counted(len(row.diagnoses), 'window')}: {said}")
        first = next((diagnosis for diagnosis in row.diagnoses if diagnosis.verdict == "anomalous"), None)
        if first is not None:
            click.echo(
                f"           first called anomalous {row.said_anomalous_s:.0f} s into the demo, for the window from"
                f" {view.hours(first.window_start_ns):.1f} h to {view.hours(first.window_end_ns):.1f} h: {first.reason}"
            )
    failing = view.rows.get(FAILING)
    if failing is None or failing.said_anomalous_s is None:
        click.echo(f"The demo ended before {FAILING} was called anomalous; a longer --duration shows it.")
    click.echo(
        f"\nThe recording is in {record}. To check that it replays: rwa-monitor replay --verify {quote(str(record))}"
    )
