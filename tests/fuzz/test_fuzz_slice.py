"""A slice of the fuzzing campaign (`make fuzz`): every reader of outside bytes, for a second or so each."""

from pathlib import Path

import hypothesis
import pytest
from hypothesis import HealthCheck, settings

from tests.fuzz.mutation import mutated
from tests.fuzz.targets import TARGETS, run

FOLDER = Path(__file__).parent / "found"
# What campaigns found, and whether it is taken now; the others are refused in one line.
FOUND = {
    "csv-exponent_of_fifty_digits": False,
    "labels-name_too_long": False,
    "messages-jumps_around_a_hole": True,
    "messages-no_path_found": True,
    "messages-window_beyond_64_bits": False,
    "parquet-fewer_rows_than_promised": False,
    "parquet-histogram": False,
    "parquet-name_is_no_text": False,
    "parquet-row_group_of_billions": True,
    "parquet-row_group_of_billions_damaged": False,
    "ros2-chunk_of_64_bits": False,
    "ros2-constant_of_many_letters": False,
    "wheel-noise_of_nothing": True,
}
# As many as a second or two allows: a replay does much more than reading a line of labels.
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


@pytest.mark.parametrize(("name", "taken"), FOUND.items(), ids=FOUND)
def test_what_was_found_once_is_mended(name: str, taken: bool) -> None:
    assert run(TARGETS[name.partition("-")[0]], (FOLDER / name).read_bytes()) is taken


def test_of_all_that_was_found_it_is_known_whether_it_is_taken() -> None:
    assert {path.name for path in FOLDER.iterdir()} == set(FOUND)
