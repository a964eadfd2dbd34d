"""`completion`: the script that lets a shell complete this program's commands and options."""

from __future__ import annotations

import click

from rwa_monitor.cli.console import PROGRAM

SHELLS = ("bash", "fish", "zsh")


@click.command(name="completion", short_help="Let a shell complete commands and options.")
@click.argument("shell", type=click.Choice(SHELLS))
@click.pass_context
def command(ctx: click.Context, shell: str) -> None:
    """Print the script for a shell.

    In ~/.bashrc or ~/.zshrc: eval "$(rwa-monitor completion bash)", or zsh. For fish, save what is printed as
    ~/.config/fish/completions/rwa-monitor.fish.
    """
    from click.shell_completion import get_completion_class

    completion = get_completion_class(shell)
    assert completion is not None, "click supports the three shells"
    variable = f"_{PROGRAM}_COMPLETE".replace("-", "_").upper()
    click.echo(completion(ctx.find_root().command, {}, PROGRAM, variable).source())
