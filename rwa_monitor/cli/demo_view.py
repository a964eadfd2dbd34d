"""What the demo shows while it runs: one row for each wheel, from what the monitor says on the bus and nothing else."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final

import click
from rich.console import Console
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from rwa_monitor.cli.diagnosis_view import VERDICT_STYLE
from rwa_monitor.live.bus import Inbox
from rwa_monitor.live.searches import PATIENCE
from rwa_monitor.messages import Changepoints, Diagnosis, Discrepancy, Gain, Message, Status
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, SECONDS_PER_HOUR

REFRESH_S: Final = 0.2
# What the view listens to, by the last part of the key.
KINDS: Final[dict[str, type[Message]]] = {kind.kind: kind for kind in (Diagnosis, Changepoints, Discrepancy, Status)}


@dataclass(slots=True)
class WheelRow:
    """What is known of one wheel.

    Attributes
    ----------
    diagnoses
        All of them, in order.
    since_ns
        Start of the first window of the present verdict; None before the first diagnosis.
    jumps
        Provisional changepoints of the running window.
    window_fill
        Share of the running window that has passed.
    said_anomalous_s
        Wall-clock time of the first anomalous verdict since the demo began [s]; None while there is none.
    misfits
        Windows in a row whose friction model did not fit.
    searched
        Whether there were once so many that the monitor began a search.
    discrepancy, discrepancy_s
        What the search found, and its wall-clock time since the demo began [s]; None while there is none.
    """

    diagnoses: list[Diagnosis] = field(default_factory=list)
    since_ns: int | None = None
    jumps: int = 0
    window_fill: float = 0.0
    said_anomalous_s: float | None = None
    misfits: int = 0
    searched: bool = False
    discrepancy: Discrepancy | None = None
    discrepancy_s: float | None = None

    @property
    def last(self) -> Diagnosis | None:
        """The latest diagnosis."""
        return self.diagnoses[-1] if self.diagnoses else None

    @property
    def model(self) -> str:
        """What is known of the wheel's friction model, in a few words."""
        if self.discrepancy is not None:
            return found_in_words(self.discrepancy)
        if self.misfits >= PATIENCE:
            return "does not fit, searching…"
        if self.misfits:
            return "does not fit"
        return "fits" if self.diagnoses else ""


class DemoView:
    """Listens on the bus, keeps a row for each wheel, and shows them.

    Where a person watches it is a live table, otherwise a line for each diagnosis.

    Parameters
    ----------
    session
        The Zenoh session.
    spacecraft
        Whose wheels to show.
    start_ns
        Where the wheels' clock begins, to show times from there.
    """

    def __init__(self, session: Any, spacecraft: str, start_ns: int) -> None:
        self.rows: dict[str, WheelRow] = {}
        self._start_ns = start_ns
        self._began = time.monotonic()
        self._inbox = Inbox()
        # The bus calls from a thread of its own, where nothing but this may happen.
        self._subscriber = session.declare_subscriber(
            f"rwa/{spacecraft}/**", lambda sample: self._inbox.put(str(sample.key_expr), sample.payload.to_bytes())
        )

    def show_until(self, done: threading.Event, seconds: float, patience_s: float) -> None:
        """Show what comes until `done` is set or the time is over; a search that has begun gets `patience_s` more."""
        console = Console(highlight=False)
        end = time.monotonic() + seconds
        with self._shown(console) as refresh:
            while not done.wait(REFRESH_S) and time.monotonic() < end + (patience_s if self._searching else 0.0):
                self.take_messages()
                refresh()

    @property
    def _searching(self) -> bool:
        """Whether the monitor searches for what a wheel's model lacks."""
        return any(row.searched and row.discrepancy is None for row in self.rows.values())

    def close(self) -> None:
        """Stop to listen, and take what still waits."""
        self._subscriber.undeclare()
        self.take_messages()

    def take_messages(self) -> None:
        """Bring what has come into the rows."""
        while (message := self._inbox.take()) is not None:
            _, _, wheel, kind = message.key.split("/")
            if kind in KINDS:
                self._take(self.rows.setdefault(wheel, WheelRow()), KINDS[kind].parse(message.payload, message.key))

    def _take(self, row: WheelRow, message: Message) -> None:
        match message:
            case Status():
                row.window_fill = message.window_fill
            case Changepoints():
                row.jumps += len(message.changepoints)
            case Diagnosis():
                if row.last is None or row.last.verdict != message.verdict:
                    row.since_ns = message.window_start_ns
                row.diagnoses.append(message)
                row.jumps = 0
                row.misfits = 0 if message.model_adequate else row.misfits + 1
                row.searched = row.searched or row.misfits >= PATIENCE
                if message.verdict == "anomalous" and row.said_anomalous_s is None:
                    row.said_anomalous_s = self.elapsed_s()
            case Discrepancy():
                row.discrepancy, row.discrepancy_s = message, self.elapsed_s()

    def elapsed_s(self) -> float:
        """Return how long the demo has been running [s]."""
        return time.monotonic() - self._began

    @contextmanager
    def _shown(self, console: Console) -> Iterator[Any]:
        """Give the function that brings the picture up to date."""
        if console.is_terminal:
            with Live(self._table(), console=console, auto_refresh=False) as live:
                yield lambda: live.update(self._table(), refresh=True)
            return
        printed: dict[str, int] = {}
        said: dict[str, str] = {}

        def print_new() -> None:
            for wheel, row in sorted(self.rows.items()):
                for diagnosis in row.diagnoses[printed.get(wheel, 0) :]:
                    click.echo(self._line(wheel, diagnosis))
                printed[wheel] = len(row.diagnoses)
                if row.model != said.get(wheel, "fits") and row.model:
                    click.echo(f"{self.elapsed_s():6.1f} s  {wheel}  model {row.model}")
                said[wheel] = row.model or "fits"

        yield print_new
        self.take_messages()
        print_new()

    def _line(self, wheel: str, diagnosis: Diagnosis) -> str:
        hours = self.hours(diagnosis.window_end_ns)
        return f"{self.elapsed_s():6.1f} s  {wheel}  {hours:5.1f} h  {diagnosis.verdict:12}  {diagnosis.reason}"

    def _table(self) -> Table:
        hours = max((self.hours(row.last.window_end_ns) for row in self.rows.values() if row.last), default=0.0)
        table = Table(title=f"simulated satellite, {hours:.1f} h of telemetry", title_justify="left", expand=True)
        for column in ("wheel", "verdict", "since", "reason", "friction model", "windows", "jumps", "window"):
            wide = column in ("reason", "friction model")
            table.add_column(column, no_wrap=not wide, ratio=1 if wide else None)
        for wheel, row in sorted(self.rows.items()):
            verdict = row.last.verdict if row.last else "waiting"
            table.add_row(
                wheel,
                Text(verdict, VERDICT_STYLE.get(verdict, "dim")),
                f"{self.hours(row.since_ns):.1f} h" if row.since_ns is not None else "",
                row.last.reason if row.last else "the first window is being filled",
                Text(row.model, "bold yellow" if row.misfits or row.discrepancy else "dim"),
                str(len(row.diagnoses)),
                str(row.jumps),
                ProgressBar(total=1.0, completed=row.window_fill, width=12),
            )
        return table

    def hours(self, time_ns: int) -> float:
        """Return a time of the wheels' clock as hours since the demo's first sample."""
        return (time_ns - self._start_ns) / NANOSECONDS_PER_SECOND / SECONDS_PER_HOUR


def found_in_words(found: Discrepancy) -> str:
    """Return what a search found, in a few words with the gain."""
    if not found.effects:
        return f"{found.verdict}, no known effect explains it" if found.unexplained else found.verdict
    effect = found.effects[0]
    words = f"lacks {effect.name}"
    if effect.equivalent:
        words += f" (or {', '.join(effect.equivalent)}: the data cannot tell)"
    if len(found.effects) > 1:
        words += f", and {', '.join(other.name for other in found.effects[1:])}"
    if found.gain is not None:
        words += f"; {gain_in_words(found.gain)}"
    return words


def gain_in_words(gain: Gain) -> str:
    """Return what the effects found gain on held-out data, before → after."""
    return (
        f"RMSE {gain.rmse_base_Nm / gain.noise_std_Nm:.3f} → {gain.rmse_extended_Nm / gain.noise_std_Nm:.3f} σ,"
        f" jumps {gain.changepoints_base} → {gain.changepoints_extended}"
    )
