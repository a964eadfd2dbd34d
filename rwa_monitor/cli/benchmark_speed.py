"""`benchmark speed`: ours, peers and limits side by side in one run."""

from __future__ import annotations

from pathlib import Path

import click

from rwa_monitor.cli.exit_codes import FAILED
from rwa_monitor.cli.options import FILE, Whole


@click.command(name="speed", short_help="How fast, beside peers and limits, in one run.")
@click.option(
    "--windows", type=Whole(5, 100_000), metavar="N", default=1_000, show_default=True, help="How many windows."
)
@click.option("--seed", type=Whole(0), metavar="N", default=8_129, show_default=True, help="Seed of the windows.")
@click.option("--json", "json_file", type=FILE, metavar="FILE", help="Keep the results there.")
@click.option("--page", type=FILE, metavar="FILE", help="Write them there as a page of Markdown.")
@click.option(
    "--from",
    "kept",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Measure nothing: show kept results again.",
)
@click.pass_context
def command(
    ctx: click.Context, windows: int, seed: int, json_file: Path | None, page: Path | None, kept: Path | None
) -> None:
    """Measure speed and memory beside peers and limits; takes about eight minutes with all peers.

    Peers are optional packages (skchange, ruptures, river); what is not installed is left out and said. Prints the
    ratios that count; exit code 1 when a target is missed.
    """
    import json

    from benchmarks.speed.benchmark import run
    from benchmarks.speed.report import SpeedReport, to_markdown
    from rwa_monitor.cli.progress import track
    from rwa_monitor.cli.talk import say
    from rwa_monitor.formats.files import write_text

    if kept is not None:
        report = SpeedReport.from_json(json.loads(kept.read_text(encoding="utf-8")))
    else:
        report = run(windows, seed, lambda items, count: track(items, count, "windows"))
    for text in report.missing:
        say(text)
    text = to_markdown(report)
    if json_file is not None:
        write_text(json_file, json.dumps(report.to_json(), indent=1, ensure_ascii=False) + "\n")
    if page is not None:
        write_text(page, text)
    click.echo(text, nl=False)
    ctx.exit(FAILED if any(target.met is False for target in report.targets) else 0)
