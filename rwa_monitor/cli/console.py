"""What a person reads while a command works: lines and progress, on stderr; stdout is for data."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Final, TypeVar

import click

PROGRAM: Final = "rwa-monitor"

Item = TypeVar("Item")


def log(*messages: str) -> None:
    """Write messages to stderr, each in one line."""
    for message in messages:
        click.echo(f"{PROGRAM}: {' '.join(message.split())}", err=True)


def track(items: Iterable[Item], total: int, description: str) -> Iterator[Item]:
    """Pass items on while a bar on stderr shows how many of `total` are done; nothing where stderr is no terminal."""
    if not sys.stderr.isatty():
        yield from items
        return
    from rich.console import Console
    from rich.progress import track as rich_track

    yield from rich_track(items, description, total=total, console=Console(stderr=True), transient=True)


@contextmanager
def status_line(description: str) -> Iterator[Callable[[str], None]]:
    """Give a function that shows what is being done, on one line of stderr; nothing where that is no terminal."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status(description) as status:
        yield lambda step: status.update(f"{description}: {step}")
