"""Lists the result pages, the make target that renews each, and which are older than the code that they measure.

    python -m benchmarks.results [--targets]

Prints a table of the pages; with `--targets` the make targets alone, as `make results` runs them. A page ends with the
commit that it was made at. Later commits that change the code it measures make it outdated, except those listed in
`unchanged.toml`; comments and docstrings do not count as code.
"""

from __future__ import annotations

import argparse
import ast
import re
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.page import NONE, table

ROOT: Final = Path(__file__).parents[1]
UNCHANGED: Final = Path(__file__).with_name("unchanged.toml")
MADE_AT: Final = re.compile(r"^\*.*\b[Cc]ommit ([0-9a-f]{7,40}) of [0-9-]{10}", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class ResultPage:
    """One page of results.

    Attributes
    ----------
    name
        Name of the file in docs/, without its suffix.
    target
        The make target that renews it.
    measures
        Paths below the root that its figures follow from, its own benchmark included.
    timed
        Whether its figures are times or counts of a machine: they differ between two runs, so that a change of the page
        does not make it wrong, only outdated.
    """

    name: str
    target: str
    measures: tuple[str, ...]
    timed: bool = False

    def made_at(self) -> str | None:
        """Return the commit that the page states; None where it states none."""
        found = MADE_AT.findall((ROOT / "docs" / f"{self.name}.md").read_text(encoding="utf-8"))
        return found[-1] if found else None

    def later_commits(self) -> list[str]:
        """Return the later commits that change the code it measures and are not in `unchanged.toml`, newest first.

        Raises
        ------
        subprocess.CalledProcessError
            If the history does not reach back to the commit of the page, as in a shallow clone.
        """
        later = _commits(f"{self.made_at()}..HEAD", *self.measures)
        blocks = tomllib.loads(UNCHANGED.read_text(encoding="utf-8")).get("unchanged", [])
        ranges = [block["commits"] for block in blocks if self.name in block["pages"]]
        shown = {commit for commits in ranges for commit in _commits(commits)}
        return [commit for commit in later if commit not in shown and _changes_code(commit.split()[0], self.measures)]


def _rooms(*names: str) -> tuple[str, ...]:
    return tuple(f"rwa_monitor/{name}" for name in names)


DIAGNOSIS: Final = _rooms("kernels", "changepoints", "switching", "diagnosis")
SEARCH: Final = _rooms("discrepancy", "wheel/effects")
PAGES: Final = (
    ResultPage("benchmark", "benchmark-accuracy", (*DIAGNOSIS, *_rooms("paper", "simulation"), "benchmarks/accuracy")),
    ResultPage("paper", "benchmark-paper", (*DIAGNOSIS, *_rooms("paper", "simulation"), "benchmarks/paper")),
    ResultPage("examples_1_2", "benchmark-examples", (*DIAGNOSIS, *_rooms("paper"), "benchmarks/paper/examples.py")),
    ResultPage(
        "adequacy", "benchmark-adequacy", (*_rooms("kernels", "changepoints", "diagnosis"), "benchmarks/adequacy")
    ),
    ResultPage("trend", "benchmark-trend", (*DIAGNOSIS, "benchmarks/trend.py")),
    ResultPage("false_alarms", "false-alarms", (*DIAGNOSIS, "benchmarks/false_alarms.py")),
    ResultPage("heat", "heat", (*DIAGNOSIS, *_rooms("identification", "wheel/effects"), "benchmarks/heat.py")),
    ResultPage("neighbours", "neighbours", (*DIAGNOSIS, *_rooms("history"), "benchmarks/neighbours.py")),
    ResultPage("blind", "blind", (*SEARCH, "benchmarks/blind")),
    ResultPage("foreign", "foreign", (*SEARCH, "benchmarks/foreign")),
    ResultPage("foreign_diagnosis", "foreign-diagnosis", (*DIAGNOSIS, "benchmarks/foreign_diagnosis.py")),
    ResultPage("measured", "measured", (*SEARCH, "benchmarks/measured.py")),
    ResultPage("faults", "faults", (*_rooms("monitor"), "tests/faults"), timed=True),
    ResultPage("fuzzing", "fuzz", (*_rooms("telemetry", "wheel", "monitor"), "tests/fuzz"), timed=True),
    ResultPage("speed", "benchmark-speed", (*DIAGNOSIS, *SEARCH, "benchmarks/speed"), timed=True),
    ResultPage("profile", "profile", (*DIAGNOSIS, *_rooms("monitor"), "benchmarks/profile_live.py"), timed=True),
    ResultPage("onboard", "onboard", (*_rooms("monitor"), "requirements-monitor.txt"), timed=True),
    ResultPage("soak", "soak", (*_rooms("monitor"), "benchmarks/soak.py"), timed=True),
    ResultPage("restart", "restart", (*_rooms("monitor"), "benchmarks/restart.py"), timed=True),
    ResultPage("fleet", "fleet", (*_rooms("batch"), "benchmarks/fleet.py"), timed=True),
    ResultPage("fleet_live", "fleet-live", (*_rooms("monitor"), "benchmarks/fleet_live.py"), timed=True),
    ResultPage("scale", "scale", ("docs/speed.json", "benchmarks/scale.py"), timed=True),
)


def _git(*arguments: str) -> str:
    return subprocess.run(("git", "-C", str(ROOT), *arguments), capture_output=True, text=True, check=True).stdout


def _commits(commits: str, *paths: str) -> list[str]:
    return _git("log", "--format=%h %s", "--no-merges", commits, "--", *paths).splitlines()


def _changes_code(commit: str, paths: tuple[str, ...]) -> bool:
    """Return whether a commit changes anything below these paths but comments, docstrings and Python layout."""
    changed = _git("diff-tree", "-r", "--no-commit-id", "--no-renames", "--name-status", commit, "--", *paths)
    for line in changed.splitlines():
        status, name = line.split("\t")
        if status != "M" or not name.endswith(".py"):
            return True
        if code_of(_git("show", f"{commit}^:{name}")) != code_of(_git("show", f"{commit}:{name}")):
            return True
    return False


def code_of(source: str) -> str:
    """Return a Python file without comments, docstrings and layout."""
    tree = ast.parse(source)
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for node in ast.walk(tree):
        if isinstance(node, documented) and ast.get_docstring(node):
            node.body = node.body[1:] or [ast.Pass()]
    return ast.unparse(tree)


def main() -> int:
    """Print the table of the pages or the targets, return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--targets", action="store_true", help="only the make targets, one a line")
    if parser.parse_args().targets:
        print(*(page.target for page in PAGES), sep="\n")
        return 0
    rows = []
    for one in PAGES:
        commit = one.made_at()
        later = one.later_commits() if commit else []
        rows.append((f"docs/{one.name}.md", f"make {one.target}", commit or NONE, f"{len(later)} commits later"))
    print(table(("page", "made by", "at", "what it measures was changed by"), rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
