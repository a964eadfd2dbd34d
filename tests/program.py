"""The program as tests run it: in this process, or in one of its own as a user does."""

import subprocess
import sys
from collections.abc import Callable

import pytest
from click.testing import CliRunner, Result

from rwa_monitor.cli.main import main
from rwa_monitor.errors import InputError


def run(*words: object) -> Result:
    """Run the program in this process, with its own exit codes; an exception that it does not handle is the test's.

    Always by the program itself: a command on its own returns its exit code, and click makes 0 of that.
    """
    result = CliRunner().invoke(main, [str(word) for word in words])
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def command(*words: object) -> list[str]:
    """Return the command line of the program in a process of its own."""
    return [sys.executable, "-m", "rwa_monitor", *map(str, words)]


def done(*words: object) -> subprocess.CompletedProcess[str]:
    """Run the program in a process of its own until it ends."""
    return subprocess.run(command(*words), capture_output=True, text=True, timeout=500, check=False)


def refused(read: Callable[[], object]) -> str:
    """Return the one printable line with which something is refused."""
    with pytest.raises(InputError) as caught:
        read()
    line = str(caught.value)
    assert line.isprintable()
    assert len(line) < 2_000
    return line
