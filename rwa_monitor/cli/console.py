"""A command's process: exit codes, log and progress on stderr (stdout is for data), a clean stop on a signal."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from threading import Event
from types import FrameType
from typing import TYPE_CHECKING, Final, TypeVar

import click

if TYPE_CHECKING:
    from rich.console import Console

PROGRAM: Final = "rwa-monitor"
WIDTH_IN_FILES: Final = 120  # characters of a line

# Exit codes; 0 is done.
FAILED: Final = 1  # or a check found a difference
WRONG_USE: Final = 2  # or bad input
UNREADABLE: Final = 3  # done, but bytes of the input could not be read

Item = TypeVar("Item")


def log(*messages: str) -> None:
    """Write messages to stderr, each in one line; an empty one is none."""
    for message in filter(None, messages):
        click.echo(f"{PROGRAM}: {' '.join(message.split())}", err=True)


def console_of_stdout() -> Console:
    """Return the console for stdout; lines have a fixed width where no terminal gives theirs."""
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = WIDTH_IN_FILES
    return console


def track(items: Iterable[Item], total: int, description: str) -> Iterable[Item]:
    """Pass items on while a bar on stderr shows how many of `total` are done; nothing where stderr is no terminal."""
    from rich.console import Console
    from rich.progress import track as rich_track

    console = Console(stderr=True)
    return rich_track(items, description, total=total, console=console, transient=True, disable=not console.is_terminal)


@contextmanager
def status_line(description: str) -> Iterator[Callable[[str], None]]:
    """Give a function that shows what is being done, on one line of stderr; nothing where that is no terminal."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status(description) as status:
        yield lambda step: status.update(f"{description}: {step}")


@contextmanager
def stop_on_signals() -> Iterator[Event]:
    """Give an event that SIGINT or SIGTERM sets; a second SIGINT interrupts at once, as it does elsewhere."""
    stop = Event()

    def stop_cleanly(number: int, frame: FrameType | None) -> None:
        del number, frame
        stop.set()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = {number: signal.signal(number, stop_cleanly) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
