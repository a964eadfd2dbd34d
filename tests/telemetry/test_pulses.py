"""The speed that pulses show: at the middle of each turn, whatever pulses are missing or too many."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from rwa_monitor.errors import InputError
from rwa_monitor.samples import FloatArray, Samples
from rwa_monitor.telemetry.pulses import speed_of_pulses


def slowing(per_turn: int, uneven: float = 0.0, turns: int = 80) -> FloatArray:
    """Return the times of pulses of a wheel that slows down evenly from 20 rad/s by 0.15 rad/s² [s]."""
    marks = np.arange(per_turn) / per_turn + uneven / per_turn * np.random.default_rng(0).uniform(-1, 1, per_turn)
    angle = 2 * np.pi * (np.arange(turns)[:, None] + marks).ravel()
    return np.asarray((20.0 - np.sqrt(400.0 - 2 * 0.15 * angle)) / 0.15)


def table(time_s: FloatArray) -> Samples:
    return Samples(np.rint(time_s * 1e9).astype(np.int64), np.full(time_s.size, np.nan))


def assert_slowing(samples: Samples, within: float) -> None:
    np.testing.assert_allclose(samples.speed_rad_s, 20.0 - 0.15 * samples.time_ns / 1e9, atol=within)


@pytest.mark.parametrize("per_turn", [1, 2, 24, 60])
@pytest.mark.parametrize("uneven", [0.0, 0.05])
def test_the_mean_over_a_turn_is_the_speed_at_its_middle(per_turn: int, uneven: float) -> None:
    found = speed_of_pulses(table(slowing(per_turn, uneven)), per_turn, "log")
    assert (found.missed, found.phantom, found.breaks) == (0, 0, 0)
    assert len(found.samples) == 79
    assert_slowing(found.samples, 1e-5)


@given(
    per_turn=st.sampled_from([1, 3, 24]),
    missed=st.sets(st.integers(3, 75), max_size=4),
    phantoms=st.sets(st.integers(3, 75), max_size=3),
    within=st.floats(0.05, 0.95),
    jitter=st.sampled_from([0.0, 1e-5]),
)
def test_missed_pulses_and_phantoms_are_counted_and_change_no_speed(
    per_turn: int, missed: set[int], phantoms: set[int], within: float, jitter: float
) -> None:
    assume(all(later - before >= 3 for before, later in pairwise(sorted([*missed, *phantoms]))))
    time = slowing(per_turn)
    time += jitter * np.random.default_rng(1).normal(size=time.size) * (time > 0)
    first = np.array(sorted(phantoms), dtype=int) * per_turn
    more = time[first] + within * (time[first + 1] - time[first])
    given_times = np.sort(np.append(np.delete(time, [at * per_turn for at in missed]), more))
    found = speed_of_pulses(table(given_times), per_turn, "log")
    assert (found.missed, found.phantom, found.breaks) == (len(missed), len(phantoms), 0)
    assert_slowing(found.samples, 0.01)
    assert len(found.samples) >= 79 - 2 * len(missed) - 2


@given(stretch=st.floats(0.01, 100.0))
def test_twice_as_slow_is_half_the_speed(stretch: float) -> None:
    plain, slower = (speed_of_pulses(table(slowing(4) * by), 4, "log").samples for by in (1.0, stretch))
    np.testing.assert_allclose(slower.speed_rad_s * stretch, plain.speed_rad_s, rtol=1e-5)


def test_no_row_reaches_over_a_break() -> None:
    time = slowing(1)
    found = speed_of_pulses(table(np.append(time, time + 3600.0)), 1, "log")
    assert (found.missed, found.phantom, found.breaks) == (0, 0, 1)
    assert len(found.samples) == 2 * 79
    later = found.samples.time_ns > 1_800_000_000_000
    assert_slowing(found.samples[~later], 1e-5)
    assert "160 pulses, 1 a turn, 1 break: 158 rows" in found.in_words(160, 1)


def test_other_channels_are_those_at_the_middle() -> None:
    pulses = table(slowing(1))
    found = speed_of_pulses(
        Samples(pulses.time_ns, pulses.speed_rad_s, bearing_temperature_degC=pulses.time_ns / 1e9), 1, "log"
    ).samples
    np.testing.assert_allclose(found.bearing_temperature_degC, found.time_ns / 1e9)


def test_what_shows_no_turns_is_refused() -> None:
    with pytest.raises(InputError, match="log: holds 30 pulses, less than two turns of pulses_per_turn = 24"):
        speed_of_pulses(table(slowing(1)[:30]), 24, "log")
    chance = np.cumsum(np.random.default_rng(0).exponential(0.1, 500))
    with pytest.raises(InputError, match="give a table of time_s and speed_rad_s"):
        speed_of_pulses(table(chance), 1, "log")
