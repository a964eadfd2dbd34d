"""The command lines that the documents show: all of them exist, and those marked `<!-- run -->` work in their order."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest

from rwa_monitor.cli.main import main as program

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"(<!-- run -->\n)?```sh\n(.*?)```", re.DOTALL)
INLINE = re.compile(r"`(rwa-monitor [a-z][^`]*)`")
GENERATED = {"reference.md"}


def _lines(page: Path, *, marked: bool) -> list[str]:
    """Return the command lines of this program in a page's blocks, all or only those marked to be run."""
    found = []
    for mark, block in BLOCK.findall(page.read_text(encoding="utf-8")):
        if mark or not marked:
            found += [line.split("  #")[0] for line in block.splitlines() if line.startswith("rwa-monitor ")]
    return found


def _inline(page: Path) -> list[str]:
    return [] if page.name in GENERATED else INLINE.findall(page.read_text(encoding="utf-8"))


def _parse(words: list[str]) -> None:
    """Let click parse a command line without running it; raises click.UsageError where it does not exist."""
    command: click.Command = program
    context = click.Context(program, info_name="rwa-monitor")
    while isinstance(command, click.Group):
        child = command.get_command(context, words[0]) if words else None
        if child is None:
            raise click.UsageError(f"no command {' '.join(words[:1])!r}")
        command, words = child, words[1:]
    command.make_context(command.name, words, parent=context)


@pytest.mark.parametrize(
    ("page", "line"),
    [(page.name, line) for page in PAGES for line in _lines(page, marked=False)],
)
def test_every_command_line_exists(page: str, line: str) -> None:
    try:
        _parse(shlex.split(line)[1:])
    except click.UsageError as error:
        pytest.fail(f"{page}: {line}: {error.format_message()}")


@pytest.mark.parametrize(("page", "line"), [(page.name, line) for page in PAGES for line in _inline(page)])
def test_every_command_named_in_the_text_exists(page: str, line: str) -> None:
    name = shlex.split(line)[1]
    assert name in program.list_commands(click.Context(program)), page


def test_a_command_line_that_does_not_exist_is_noticed() -> None:
    for words in (["diagnoze", "x.csv"], ["diagnose", "--no-such-option", "x.csv"], ["simulate", "recording"]):
        with pytest.raises(click.UsageError):
            _parse(words)


@pytest.mark.slow
def test_marked_command_lines_work_in_their_order(tmp_path: Path) -> None:
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    (tmp_path / "replay").symlink_to(ROOT / "replay")
    lines = _lines(ROOT / "README.md", marked=True)
    assert len(lines) >= 4
    said = ""
    for line in lines:
        command = [sys.executable, "-m", "rwa_monitor.cli", *shlex.split(line)[1:]]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=240, check=False)
        assert done.returncode == 0, f"{line}: {done.stderr}"
        said += done.stdout
    assert "ANOMALOUS  Friction of switching system fss_2" in said
    assert "16: 12 fss_1, 4 fss_2" in said


def test_every_test_that_a_promise_names_exists() -> None:
    text = (ROOT / "docs" / "promises.md").read_text(encoding="utf-8")
    named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", text)
    assert named
    for file, test in named:
        assert f"def {test}(" in (ROOT / file).read_text(encoding="utf-8"), f"{file}::{test}"


def test_every_command_that_a_promise_names_exists() -> None:
    rows = [
        line for line in (ROOT / "docs" / "promises.md").read_text(encoding="utf-8").splitlines() if line[0:2] == "| "
    ]
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for row in rows[1:]:
        commands = re.findall(r"`([^`]+)`", row.strip("| ").rsplit(" | ", 1)[1])
        assert commands, row
        for command in commands:
            program_name, *words = shlex.split(command)
            if program_name == "make":
                assert all(re.search(rf"^{word}:", makefile, re.MULTILINE) for word in words), command
            elif program_name in {"pytest", "python"}:
                assert all((ROOT / word).exists() for word in words if word.endswith(".py")), command
            else:
                assert program_name == "rwa-monitor", command
