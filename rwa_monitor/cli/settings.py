"""Options from a file and from the environment, with the names they have on the command line.

```toml
[run]
record = "/var/lib/rwa-monitor"
connect = ["tls/router:7447"]

[simulate.publish]
speed = 300.0
```

The same from the environment: `RWA_MONITOR_RUN_RECORD`, `RWA_MONITOR_SIMULATE_PUBLISH_SPEED`. What may be given several
times is a list in the file, and parted by spaces in the environment: `RWA_MONITOR_RUN_CONNECT="tls/a:7447 tls/b:7447"`.
The command line goes before the environment, the environment before the file, and the file before the default.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import click

from rwa_monitor.errors import InputError, did_you_mean
from rwa_monitor.telemetry.files import display_name, read_checked_text
from rwa_monitor.wheel.toml import parse_toml

MAX_BYTES: Final = 1_000_000  # of a settings file
PREFIX: Final = "RWA_MONITOR_"  # of the variables
# Which file, and what click itself takes for options of `dashboard`.
OTHERS: Final = frozenset({"RWA_MONITOR_SETTINGS", "RWA_MONITOR_HISTORY", "RWA_MONITOR_TOKEN"})

Settings = dict[str, Any]  # by command, then by parameter, as click takes its default map


def read_settings(
    path: Path | None, environment: Mapping[str, str], program: click.Group, ctx: click.Context
) -> Settings:
    """Return what the file and, before it, the environment set.

    Variables that set no option are left alone, since other programs make some that begin like ours; `doctor` names
    them all, a command those that begin with its name.

    Raises
    ------
    InputError
        If the file cannot be read, or names a command or an option that does not exist; or if an option cannot have the
        value that it is given.
    """
    settings: Settings = {}
    if path is not None:
        source = display_name(path)
        tables = parse_toml(read_checked_text(path, MAX_BYTES), source, MAX_BYTES, "a settings file")
        settings = _of_tables(tables, program, ctx, source, "")
    for variable, (commands, option) in _variables(program, ctx).items():
        if variable in environment:
            text = environment[variable]
            value = text.split() if option.multiple else text
            _check(option, value, ctx, "environment", variable)
            table = settings
            for name in commands:
                table = table.setdefault(name, {})
            table[str(option.name)] = value
    return settings


def unknown_variables(environment: Mapping[str, str], program: click.Group, ctx: click.Context) -> dict[str, str]:
    """Return the variables that begin like ours and set no option, each with "; did you mean …?" where one is near."""
    known = _variables(program, ctx)
    ours = sorted(name for name in environment if name.startswith(PREFIX) and name not in {*known, *OTHERS})
    return {name: did_you_mean(name, known) for name in ours}


def _variables(
    group: click.Group, ctx: click.Context, parents: tuple[str, ...] = ()
) -> dict[str, tuple[tuple[str, ...], click.Option]]:
    """Return the option that each variable sets, with the names of its command and of the groups above."""
    found: dict[str, tuple[tuple[str, ...], click.Option]] = {}
    for name in group.list_commands(ctx):
        command, path = group.get_command(ctx, name), (*parents, name)
        if isinstance(command, click.Group):
            found |= _variables(command, ctx, path)
        elif command is not None:
            for key, option in _options(command):
                found[PREFIX + "_".join((*path, key)).upper().replace("-", "_")] = path, option
    return found


def _of_tables(tables: dict[str, Any], group: click.Group, ctx: click.Context, source: str, place: str) -> Settings:
    """Check the tables of a file, and return them by the names of parameters."""
    found: Settings = {}
    for name, table in tables.items():
        here = f"{place}{name}"
        command = group.get_command(ctx, name)
        if command is None:
            names = group.list_commands(ctx)
            hint = did_you_mean(name, names) or f"; there are {', '.join(names)}"
            raise InputError(source, f"no command has this name{hint}", here)
        if not isinstance(table, dict):
            raise InputError(source, f"is no table of options, such as [{here}]", here)
        if isinstance(command, click.Group):
            found[name] = _of_tables(table, command, ctx, source, f"{here}.")
            continue
        options = dict(_options(command))
        found[name] = {}
        for key, value in table.items():
            option = options.get(key)
            if option is None:
                hint = did_you_mean(key, options) or f"; there are {', '.join(sorted(options))}"
                raise InputError(source, f"no option has this name{hint}", f"{here}.{key}")
            _check(option, value, ctx, source, f"{here}.{key}")
            found[name][str(option.name)] = value
    return found


def _check(option: click.Option, value: Any, ctx: click.Context, source: str, place: str) -> None:
    if option.multiple and not isinstance(value, list):
        written = f"{place.rpartition('.')[2]} = [{json.dumps(value, default=str)}]"
        raise InputError(source, f"write a list: {written}", place)
    if isinstance(option.type, click.Path):
        for one in value if option.multiple else [value]:
            if not isinstance(one, str):
                raise InputError(source, f"{one!r} is no name of a file or folder", place)
    try:
        option.type_cast_value(ctx, value)
    except click.BadParameter as error:
        raise InputError(source, error.message, place) from error


def _options(command: click.Command) -> Iterator[tuple[str, click.Option]]:
    """Yield the options of a command by their names without the dashes before them."""
    for option in command.params:
        if isinstance(option, click.Option):
            yield from ((name.removeprefix("--"), option) for name in option.opts if name.startswith("--"))
