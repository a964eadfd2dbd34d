"""The documents build into a site without a warning, every page is in its menu, and formulas need no script."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the site, built with warnings as errors."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=500, check=False)
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    return folder


def test_formulas_are_mathml(site: Path) -> None:
    theory = (site / "theory" / "index.html").read_text(encoding="utf-8")
    assert "<math" in theory
    assert "arithmatex" not in theory


def test_every_page_stands_in_the_menu() -> None:
    # Each effect's page is listed by their index.
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = {page.name for page in (ROOT / "docs").glob("*.md")}
    assert pages == set(re.findall(r": ([\w]+\.md)$", menu, re.MULTILINE))


def test_reading_the_site_fetches_nothing_from_elsewhere(site: Path) -> None:
    loads = r'<(?:script|img)[^>]+src="(https?:[^"]+)"|<link[^>]+rel="stylesheet"[^>]+href="(https?:[^"]+)"'
    for page in site.rglob("*.html"):
        loaded = re.findall(loads, page.read_text(encoding="utf-8"))
        assert not loaded, f"{page.name}: {loaded}"
