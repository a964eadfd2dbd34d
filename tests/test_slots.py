"""The slot grid."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.samples import SlotGrid, period_ns

times = st.integers(-(2**60), 2**60)
periods = st.integers(1_000, 10**12)


@given(times, periods, st.integers(-(10**6), 10**6))
def test_the_time_of_a_slot_is_in_that_slot(origin, period, slot):
    grid = SlotGrid(origin, period)
    time = grid.time_of(slot)
    if abs(time) < 2**61:
        assert grid.slot_of(np.array([time]))[0] == slot


@given(times, st.integers(-(2**60), 2**60), periods)
def test_slots_are_the_rounded_quotient(origin, offset, period):
    """Against exact fractions; halves go up."""
    slot = int(SlotGrid(origin, period).slot_of(np.array([origin + offset]))[0])
    exact = Fraction(offset, period)
    assert slot - Fraction(1, 2) <= exact < slot + Fraction(1, 2)


def test_jitter_below_half_a_period_changes_no_slot():
    grid = SlotGrid(7, 125_000_000)
    rng = np.random.default_rng(0)
    slots = np.arange(1_000)
    jitter = rng.integers(-62_500_000, 62_500_000, slots.size)
    assert np.array_equal(grid.slot_of(7 + slots * 125_000_000 + jitter), slots)


def test_halfway_belongs_to_the_later_slot():
    grid = SlotGrid(0, 1_000)
    assert grid.slot_of(np.array([499, 500, 501, -500, -501])).tolist() == [0, 1, 1, 0, -1]


@pytest.mark.parametrize(("seconds", "expected"), [(0.125, 125_000_000), (0.005, 5_000_000), (1 / 3, 333_333_333)])
def test_period_in_nanoseconds(seconds, expected):
    assert period_ns(seconds) == expected
