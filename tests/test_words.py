"""How times and lists are written for a person."""

import pytest

from rwa_monitor.words import first_few, time_text


@pytest.mark.parametrize(
    ("time_ns", "text"),
    [
        (0, "0.000 s"),
        (-1_500_000_000, "-1.500 s"),
        (631_151_999_999_000_000, "631151999.999 s"),
        (631_152_000_000_000_000, "1990-01-01T00:00:00.000Z"),
        (1_788_220_800_004_000_000, "2026-09-01T00:00:00.004Z"),
        (1_788_220_799_999_600_000, "2026-09-01T00:00:00.000Z"),
        (4_000_000_000_000_000_000, "2096-10-02T07:06:40.000Z"),
    ],
)
def test_a_time_is_utc_where_the_clock_shows_it(time_ns: int, text: str) -> None:
    assert time_text(time_ns) == text


def test_of_a_long_list_the_rest_is_counted() -> None:
    assert first_few("abcdefghij") == "a, b, c, d, e, f, g, h and 2 more"
