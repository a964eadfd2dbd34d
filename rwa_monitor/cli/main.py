"""The program `rwa-monitor`: imports a command's module when the command is called, and maps errors to exit codes.

Exit codes: 0 done; 1 failed, or a check found a difference; 2 wrong use or bad input; 3 done, but bytes of the input
could not be read; 130 interrupted. An error that a user can act on is one line on stderr. Any other is a fault of this
program and is reported with its traceback.
"""

import os
import signal
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import click

from rwa_monitor.cli.options import FAILED, FILE, PROGRAM, WRONG_USE, flag, log, option
from rwa_monitor.errors import InputError, RwaMonitorError, did_you_mean

# One thread for linear algebra, whatever the environment sets: the matrices are small, so that threads would only wait
# for each other, and the order of sums, hence the last bit, would depend on the machine. It is set before numpy is
# imported, and for all child processes; for use from Python, rwa_monitor.threads does it.
os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")

# The module of each command, which has a function of the command's name. Modules import what they need only when the
# command runs, so that --help and a mistyped option answer at once.
COMMANDS: Final = {
    "demo": "demo",
    "run": "run",
    "simulate": "simulate",
    "train": "learn",
    "diagnose": "diagnose",
    "evaluate": "evaluate",
    "discrepancy": "discrepancy",
    "export": "export",
    "identify": "learn",
    "tune": "choose",
    "manoeuvre": "choose",
    "replay": "replay",
    "recover": "replay",
    "bridge": "space_packets",
    "packets": "space_packets",
    "foxglove": "replay",
    "dashboard": "dashboard",
    "doctor": "doctor",
}


class Program(click.Group):
    """The group of all commands, with the exit codes of this program.

    Precedence of options: command line, environment, file of --settings, default.
    """

    def list_commands(self, ctx: click.Context) -> list[str]:
        del ctx
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        del ctx
        module = COMMANDS.get(cmd_name)
        return getattr(import_module(f"rwa_monitor.cli.{module}"), cmd_name) if module else None

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Run the program; without `standalone_mode`, errors are raised and the result is returned, as in click.

        A closed pipe on stdout ends the program quietly: click and rich handle that.
        """
        run: Callable[..., Any] = super().main
        if not standalone_mode:
            return run(*args, standalone_mode=False, **extra)
        status: int | None
        try:
            status = run(*args, standalone_mode=False, **{"prog_name": PROGRAM, **extra})
        except RwaMonitorError as error:
            log(str(error))
            status = WRONG_USE if isinstance(error, InputError) else FAILED
        except click.ClickException as error:
            context = error.ctx if isinstance(error, click.UsageError) else None
            hint = f" (see '{context.command_path} --help')" if context else ""
            log(f"{error.format_message()}{hint}")
            status = error.exit_code
        except ModuleNotFoundError as error:
            if error.name is None or error.name.startswith("rwa_monitor"):
                raise
            log(f"the package {error.name} is missing: install rwa-monitor again, with pip install .")
            status = FAILED
        except click.Abort:
            status = 128 + signal.SIGINT  # the exit code of shells
        sys.exit(status or 0)


@click.group(
    name=PROGRAM,
    cls=Program,
    commands=dict.fromkeys(COMMANDS),  # only names, which click uses to suggest a mistyped command
    invoke_without_command=True,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "max_content_width": 100,
        "show_default": True,
        "auto_envvar_prefix": "RWA_MONITOR",
    },
)
@option(
    "--settings",
    FILE,
    "S.toml",
    "Options from a file, a table for each command; RWA_MONITOR_<COMMAND>_<OPTION> goes before it.",
)
@flag("--version", "Show the version, and the commit it was built from; then exit.")
@click.pass_context
def main(ctx: click.Context, settings: Path | None, version: bool) -> None:
    """Watch reaction wheels through their friction.

    Splits a wheel's friction into its physical parts, reports which part is anomalous and why, and reports when its
    own model of the wheel is wrong. The command demo shows all of it on simulated wheels.
    """
    if version:
        from rwa_monitor import __version__

        click.echo(f"{PROGRAM} {__version__}")
        ctx.exit()
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help(), err=True)
        ctx.exit(WRONG_USE)
    if settings is not None:
        from rwa_monitor.telemetry.files import display_name, read_text
        from rwa_monitor.wheel.file_content import MAX_CONTENT_BYTES, parse_toml

        source, text = display_name(settings), read_text(settings, MAX_CONTENT_BYTES)
        tables = parse_toml(text, source, "a settings file")
        ctx.default_map = _defaults(tables, main, ctx, source, "")


# ---- options from a file ---------------------------------------------------------------------------------------------


def _defaults(table: Any, command: click.Command, ctx: click.Context, source: str, place: str) -> dict[str, Any]:
    """Return a table of a settings file as click's default map, with values as on the command line.

    Raises
    ------
    InputError
        If it names a command or an option that does not exist.
    """
    if not isinstance(table, dict):
        raise InputError(source, f"is no table of options, such as [{place}]", place)
    group = command if isinstance(command, click.Group) else None
    options = {str(one.name).replace("_", "-"): one for one in command.params if isinstance(one, click.Option)}
    known = group.list_commands(ctx) if group else list(options)
    found: dict[str, Any] = {}
    for name, value in table.items():
        here = f"{place}.{name}" if place else name
        if name not in known:
            raise InputError(source, f"is no command and no option{did_you_mean(name, known)}", here)
        if group and (inner := group.get_command(ctx, name)):
            found[name] = _defaults(value, inner, ctx, source, here)
        else:
            values = [str(one) for one in (value if isinstance(value, list) else [value])]
            found[str(options[name].name)] = values if options[name].multiple else " ".join(values)
    return found
