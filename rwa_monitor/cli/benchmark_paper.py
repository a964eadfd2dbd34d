"""`benchmark paper`: every table and figure of the paper, measured again, beside the oracles and peers."""

from __future__ import annotations

from pathlib import Path

import click

from rwa_monitor.cli.exit_codes import FAILED
from rwa_monitor.cli.options import FILE, Whole


@click.command(name="paper", short_help="Every table and figure of the paper, measured again.")
@click.option("--windows", type=Whole(20, 100_000), metavar="N", help="How many windows.  [default: 300]")
@click.option("--seed", type=Whole(0), metavar="N", default=8_130, show_default=True, help="Seed of the windows.")
@click.option(
    "--workers", type=Whole(0), metavar="N", default=2, show_default=True, help="Processes; 0 works in this one."
)
@click.option("--quick", is_flag=True, help="A small version: few windows and splits, and only the quick peers.")
@click.option("--page", type=FILE, metavar="FILE", help="Write the page there, its pictures in pictures/ beside it.")
@click.pass_context
def command(ctx: click.Context, windows: int | None, seed: int, workers: int, quick: bool, page: Path | None) -> None:
    """Measure every table and figure of the paper again, beside oracles and other packages.

    Takes some minutes. Prints a page of Markdown. The other packages (skchange, ruptures) are optional; what is not
    installed is left out and said. Exit code 1 when the method joint misses a target.
    """
    from dataclasses import replace

    from benchmarks.paper.benchmark import Size, paper_targets, run
    from benchmarks.paper.page import to_markdown
    from benchmarks.paper.pictures import pictures
    from rwa_monitor.cli.progress import track
    from rwa_monitor.cli.talk import say
    from rwa_monitor.formats.files import write_text

    size = replace(Size(), seed=seed)
    if quick:
        size = size.quick()
    if windows is not None:
        size = replace(size, windows=windows)
    found = run(size, workers, track)
    for text in found.missing:
        say(text)
    stem = page.stem if page else "paper"
    options = f"{' --quick' if quick else ''} --windows {size.windows} --seed {size.seed}"
    text = to_markdown(found, f"rwa-monitor benchmark paper{options}", f"pictures/{stem}_")
    if page is not None:
        folder = page.parent / "pictures"
        folder.mkdir(parents=True, exist_ok=True)
        for name, drawing in pictures(found).items():
            write_text(folder / f"{stem}_{name}.svg", drawing)
        write_text(page, text)
    click.echo(text, nl=False)
    missed = [target for target in paper_targets(found) if not target.met] if found.enough else []
    for target in missed:
        say(f"missed: {target.name}: {target.reached:.4f}, wanted {target.wanted:.4f}")
    ctx.exit(FAILED if missed else 0)
