"""The generated pages are those of the code, and every page shows what there is."""

import re
import runpy
import tomllib
from pathlib import Path

import pytest

from rwa_monitor.wheel.effects.catalogue import CATALOGUE

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
WRITTEN = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *DOCS.rglob("*.md")])
GENERATOR = runpy.run_path(str(DOCS / "make.py"))


def test_generated_pages_are_those_of_the_code() -> None:
    for name, text in GENERATOR["pages"]().items():
        assert (DOCS / name).read_text(encoding="utf-8") == text, f"docs/{name} is old: python docs/make.py"


def test_every_effect_has_a_page_and_a_picture_and_nothing_else_has() -> None:
    pages = {file.stem for file in (DOCS / "effects").glob("*.md")} - {"index", "formula"}
    assert pages == set(CATALOGUE)
    assert {file.stem for file in (DOCS / "effects" / "pictures").glob("*.png")} == set(CATALOGUE)


def test_a_picture_is_drawn_by_its_code(tmp_path: Path) -> None:
    file = tmp_path / "stribeck.png"
    GENERATOR["draw_effect"](CATALOGUE["stribeck"], file)
    assert file.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("page", WRITTEN, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_inside_the_repository_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if not re.match(r"[a-z]+:", target):
            assert (page.parent / target).exists(), f"{target} in {page.name}"


def test_the_rooms_of_the_architecture_are_those_of_the_package() -> None:
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    rows = page.partition("## The rooms")[2].partition("## ")[0]
    told = set(re.findall(r"`([a-z_]+(?:\.py|/))`", "\n".join(re.findall(r"^\| ([^|]*) \|", rows, re.MULTILINE))))
    package = ROOT / "rwa_monitor"
    there = {f"{path.name}/" for path in package.iterdir() if (path / "__init__.py").is_file()}
    there |= {path.name for path in package.glob("*.py") if not path.name.startswith("__")}
    assert told == there
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    layers = " ".join(project["tool"]["importlinter"]["contracts"][0]["layers"])
    assert set(re.findall(r"rwa_monitor\.(\w+)", layers)) == {re.split(r"[./]", name)[0] for name in there}
