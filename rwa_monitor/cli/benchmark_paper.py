"""`benchmark paper`: every table and figure of the paper, measured again, beside the oracles and peers."""

from __future__ import annotations

import click


@click.command(name="paper", short_help="Every table and figure of the paper, measured again.")
def command() -> None:
    """Measure every table and figure of the paper again and print them as a page of Markdown."""
    from rwa_monitor.evaluation.paper_page.page import run_length_section
    from rwa_monitor.evaluation.paper_page.run_length import run_lengths

    click.echo(run_length_section(run_lengths()))
