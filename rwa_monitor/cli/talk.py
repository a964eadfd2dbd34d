"""What the program says to a person: one line each, on stderr; stdout is for data."""

from __future__ import annotations

from typing import Final

import click

PROGRAM: Final = "rwa-monitor"


def say(message: str) -> None:
    """Say something on stderr, in one line."""
    click.echo(f"{PROGRAM}: {' '.join(message.split())}", err=True)
