"""How the core is installed alone: its lock is part of the other, complete and hashed, and every page says so."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PLACES = ["README.md", "docs/onboard.md", "docker/rwa-monitor.service", "Makefile", "docker/Dockerfile"]


def _locked(name: str) -> dict[str, str]:
    """Return the whole entry, hashes included, of each package of a lock."""
    text = (ROOT / name).read_text(encoding="utf-8")
    entries = re.split(r"\n(?=\S)", "\n".join(line for line in text.splitlines() if not line.startswith("#")))
    return {canonicalize_name(re.split(r"[=\[ ]", entry)[0]): entry for entry in entries if "==" in entry}


def _names(lines: list[str]) -> set[str]:
    return {canonicalize_name(Requirement(line).name) for line in lines}


def test_the_lock_of_the_core_is_that_of_the_program_less_the_page_and_the_database() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    core, program = _locked("requirements-core.txt"), _locked("requirements.txt")
    assert core.items() <= program.items()  # the same versions and the same hashes
    assert all("--hash=sha256:" in entry for entry in core.values())
    wanted = _names(project["dependencies"])
    assert wanted | _names(extras["build"]) <= set(core)  # the backend too: nothing is fetched past the hashes
    assert set(core).isdisjoint(_names(extras["dashboard"]) | _names(extras["postgresql"]))


@pytest.mark.parametrize("place", PLACES)
def test_nobody_is_told_to_install_past_the_lock(place: str) -> None:
    lines = (ROOT / place).read_text(encoding="utf-8").splitlines()
    ours = [line for line in lines if "install" in line.lower() and "--no-deps" in line]
    assert ours, place
    assert all("--no-deps --no-build-isolation" in line for line in ours), ours


def test_the_unit_and_the_pages_install_the_lock_of_the_core() -> None:
    for place in PLACES[:3]:
        assert "pip install --require-hashes -r requirements-core.txt" in (ROOT / place).read_text(encoding="utf-8"), (
            place
        )
