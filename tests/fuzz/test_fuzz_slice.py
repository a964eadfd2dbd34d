"""A slice of the fuzzing campaign (`make fuzz`): every reader of outside bytes, for a second or so each."""

from __future__ import annotations

from pathlib import Path

import hypothesis
import pytest
from hypothesis import HealthCheck, settings

from tests.fuzz.mutation import mutated
from tests.fuzz.targets import TARGETS, run

# As many as a second or two allows: a replay does much more than reading a line of labels.
FOUND = sorted((Path(__file__).parent / "found").iterdir())
EXAMPLES = {"messages": 100, "csv": 80, "parquet": 80, "wheel": 60, "model": 80, "mcap": 40, "replay": 12}


@pytest.mark.parametrize("name", list(TARGETS))
def test_what_is_good_is_taken(name: str) -> None:
    target = TARGETS[name]
    assert all(run(target, seed) for seed in target.seeds())


@pytest.mark.parametrize("name", list(TARGETS))
def test_what_is_damaged_is_taken_or_refused_in_one_line(name: str) -> None:
    target = TARGETS[name]
    told: list[bool] = []

    @settings(
        max_examples=EXAMPLES.get(name, 200),
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    @hypothesis.given(mutated(target.seeds()))
    def look(data: bytes) -> None:
        told.append(run(target, data))

    look()
    assert not all(told)  # some of it was damaged


@pytest.mark.parametrize("path", FOUND, ids=lambda path: path.name)
def test_what_was_found_once_is_mended(path: Path) -> None:
    run(TARGETS[path.name.split("-")[0]], path.read_bytes())
