"""Times that a person writes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.cli.replay import time_of
from rwa_monitor.words import time_text


@given(st.integers(-(2**61), 2**61 - 1))
def test_a_time_that_is_told_is_understood_again_to_the_millisecond(time_ns: int) -> None:
    assert abs(time_of(time_text(time_ns)) - time_ns) <= 500_000


@pytest.mark.parametrize(
    ("text", "time_ns"),
    [
        ("2026-09-01", 1_788_220_800_000_000_000),
        ("2026-09-01T02:00+02:00", 1_788_220_800_000_000_000),
        ("2026-09-01 00:00:00.004", 1_788_220_800_004_000_000),
        ("12.5", 12_500_000_000),
    ],
)
def test_a_time_may_be_written_as_people_do(text: str, time_ns: int) -> None:
    assert time_of(text) == time_ns


@pytest.mark.parametrize("text", ["", "noon", "nan", "inf", "1e999999", "2026-13-01"])
def test_what_is_no_time_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        time_of(text)
