"""`benchmark`: measured side by side with the paper and with peers. Each benchmark is a module of its own."""

from __future__ import annotations

from typing import Final

import click

from rwa_monitor.cli.lazy import LazyGroup

MODULES: Final = {
    "paper": "rwa_monitor.cli.benchmark_paper",
    "speed": "rwa_monitor.cli.benchmark_speed",
}


@click.group(
    name="benchmark",
    cls=LazyGroup,
    modules=MODULES,
    short_help="Measure beside the paper and peers.",
    no_args_is_help=False,
)
def command() -> None:
    """Measure this program beside the paper and beside others that do the same job; exit code 1 on a missed target."""
