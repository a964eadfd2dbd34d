"""Pages of results: each states where it is from, and none is older than what it measures."""

import subprocess
from pathlib import Path

import pytest

from benchmarks.profile_live import STAGES
from benchmarks.results import PAGES, ROOT, ResultPage, code_of

TARGETS = (ROOT / "Makefile").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_is_no_older_than_what_it_measures(page: ResultPage) -> None:
    commit = page.made_at()
    assert commit, f"docs/{page.name}.md does not state its commit: make {page.target}"
    if page.timed:
        return
    try:
        later = page.later_commits()
    except subprocess.CalledProcessError:
        pytest.skip(f"the history does not reach back to {commit}")
    listed = "\n".join(later)
    assert not later, (
        f"docs/{page.name}.md was made at {commit}; make {page.target}, or show that these left its figures alone and "
        f"add them to benchmarks/unchanged.toml:\n{listed}"
    )


def test_a_comment_makes_no_page_old_and_a_figure_does() -> None:
    plain = "def half(value):\n    return value / 2\n"
    commented = 'def half(value):\n    """Return half."""\n    # Of it.\n    return (\n        value / 2\n    )\n'
    assert code_of(commented) == code_of(plain)
    assert code_of(plain.replace("2", "3")) != code_of(plain)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_makes_a_page_and_what_it_measures_are_there(page: ResultPage) -> None:
    assert f"\n{page.target}: " in TARGETS
    assert [path for path in page.measures if not Path(ROOT, path).exists()] == []


# ---- what `make profile` times ---------------------------------------------------------------------------------------


def test_every_stage_of_the_profile_is_still_there() -> None:
    assert [stage for stage, (owner, name) in STAGES.items() if not callable(getattr(owner, name, None))] == []
