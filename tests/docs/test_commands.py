"""The command lines that the documents show: all of them exist, and those marked `<!-- run -->` work in their order."""

import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import click
import pytest

import rwa_monitor
from rwa_monitor.cli.main import main as program

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"(?:<!-- (?P<mark>[^>]*) -->\n)?```(?P<language>\w+)\n(?P<text>.*?)```", re.DOTALL)
INLINE = re.compile(r"`(rwa-monitor [a-z][^`]*)`")
GENERATED = {"reference.md"}


@dataclass(frozen=True)
class Block:
    """A block of code on a page: `mark` is "run", "file NAME" or empty."""

    mark: str
    language: str
    text: str

    @property
    def lines(self) -> list[str]:
        """The command lines of this program."""
        if self.language != "sh":
            return []
        return [line.split("  #")[0] for line in self.text.splitlines() if line.startswith("rwa-monitor ")]


def blocks_of(page: Path) -> list[Block]:
    """Return the blocks of code of a page, in its order."""
    found = BLOCK.finditer(page.read_text(encoding="utf-8"))
    return [Block(block["mark"] or "", block["language"], block["text"]) for block in found]


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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_line_exists(page: Path) -> None:
    for line in (line for block in blocks_of(page) for line in block.lines):
        wrong = ""
        try:
            _parse(shlex.split(line)[1:])
        except click.UsageError as error:
            wrong = error.format_message()
        assert not wrong, line
    named = [] if page.name in GENERATED else INLINE.findall(page.read_text(encoding="utf-8"))
    assert {shlex.split(line)[1] for line in named} <= {*program.list_commands(click.Context(program))}


def test_a_command_line_that_does_not_exist_is_noticed() -> None:
    for words in (["diagnoze", "x.csv"], ["diagnose", "--no-such-option", "x.csv"], ["simulate", "recording"]):
        with pytest.raises(click.UsageError):
            _parse(words)


# What a page must have printed when all its blocks have run.
SAID = {
    "README.md": ("ANOMALOUS  Friction of switching system fss_2", "16: 12 fss_1, 4 fss_2"),
    "tutorial.md": ("NOMINAL  All friction is nominal", "The simulation lacks stribeck"),
    "formats.md": ("rw-1.csv: 2 samples\nrw-2.csv: 1 samples",),
    "evaluate.md": ("viscous  diagnoses       1         1       0      1.000   1.000  1.000      1.000   1.000  ",),
    "export.md": ("The simulation lacks quadratic drag (windage).\n", "RMSE 37."),
    "test_bench.md": (
        "The simulation lacks quadratic drag (windage).\n",
        "The simulation lacks stribeck",
        "motor off: friction is -J dω/dt, which the inertia only scales",
        "torque_bias  strength_Nm = 0.06007 ±",
        "The simulation lacks torque_ripple.",
    ),
    "python.md": (
        "anomalous Viscous friction is",
        "own arrays: nominal",
        "refused: samples: speed_rad_s: has shape (12000,)",
        "stribeck ",
        "compared: equal",  # byte for byte on the processor that made it
    ),
}


def test_every_page_with_code_to_run_is_run() -> None:
    # A file of the page is run by the commands behind it, or, where it talks to a monitor, by a test of its own.
    runs = {
        page.name
        for page in PAGES
        for block in blocks_of(page)
        if block.mark == "run" or (block.language == "python" and not block.mark.startswith("file "))
    }
    assert runs == set(SAID)


@pytest.mark.parametrize(
    "name",
    [name if name in ("README.md", "export.md") else pytest.param(name, marks=pytest.mark.slow) for name in SAID],
)
def test_the_code_of_a_page_works_in_its_order(name: str, tmp_path: Path) -> None:
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    (tmp_path / "replay").symlink_to(ROOT / "replay")
    said = ""
    for block in blocks_of(next(page for page in PAGES if page.name == name)):
        if block.mark.startswith("file "):
            (tmp_path / block.mark.removeprefix("file ")).write_text(block.text, encoding="utf-8")
            continue
        commands = [["-c", block.text]] if block.language == "python" else []
        if block.mark == "run":
            commands = [["-m", "rwa_monitor", *shlex.split(line)[1:]] for line in block.lines]
            assert commands, block.text
        for command in commands:
            done = subprocess.run(
                [sys.executable, *command], cwd=tmp_path, capture_output=True, text=True, timeout=500, check=False
            )
            assert done.returncode == 0, f"{' '.join(command)}: {done.stderr}"
            said += done.stdout
    for words in SAID[name]:
        assert words in said


def test_the_python_of_the_pages_passes_a_strict_type_checker(tmp_path: Path) -> None:
    files = []
    for page in (ROOT / "docs" / "python.md", ROOT / "docs" / "publish.md"):
        for number, block in enumerate(block for block in blocks_of(page) if block.language == "python"):
            files.append(tmp_path / f"{page.stem}_{number}.py")
            files[-1].write_text(block.text, encoding="utf-8")
    assert len(files) > 8
    command = [sys.executable, "-m", "mypy", "--strict", *map(str, files)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=500, check=False)
    assert done.returncode == 0, done.stdout


def test_the_python_page_names_what_is_public() -> None:
    table = (ROOT / "docs" / "python.md").read_text(encoding="utf-8").split("## Read, or simulate")[0]
    rows = " ".join(line for line in table.splitlines() if line.startswith("| `"))
    named = set(re.findall(r"`(\w+)`", rows))
    assert set(rwa_monitor.__all__) - {"__version__", "plot"} <= named
    assert set(rwa_monitor.plot.__all__) <= named


@pytest.mark.parametrize("page", ["promises.md", "threats.md"])
def test_every_test_that_a_table_names_exists(page: str) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", text)
    assert named
    for file, test in named:
        assert f"def {test}(" in (ROOT / file).read_text(encoding="utf-8"), f"{file}::{test}"


def test_every_threat_has_a_test() -> None:
    tables = (ROOT / "docs" / "threats.md").read_text(encoding="utf-8").split("## What is not covered")[0]
    rows = [line for line in tables.splitlines() if line.startswith("| ") and not line.startswith("| threat ")]
    assert len(rows) > 30
    assert [row for row in rows if "`tests/" not in row.rsplit(" | ", 1)[1]] == []


def test_every_command_that_a_promise_names_exists() -> None:
    page = (ROOT / "docs" / "promises.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line[0:2] == "| "]
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
