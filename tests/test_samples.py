"""Samples: one struct of arrays, and the grid of their slots."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.errors import InputError
from rwa_monitor.samples import TABLE_CHANNELS, Samples, SlotGrid, concatenate, period_ns


def samples(n=10, **channels):
    return Samples(time_ns=np.arange(n), speed_rad_s=np.arange(n) / 2, **channels)


@pytest.mark.parametrize("name", TABLE_CHANNELS)
def test_arrays_of_unequal_length_are_refused(name):
    with pytest.raises(InputError, match=f"samples: {name}: has shape"):
        Samples(**{"time_ns": np.arange(3), "speed_rad_s": np.zeros(3), name: np.zeros(4)})
    with pytest.raises(InputError, match=f"samples: {name}: has shape"):
        Samples(**{"time_ns": np.arange(4), "speed_rad_s": np.zeros(4), name: np.zeros((2, 2))})


def test_joining_what_does_not_fit_is_refused():
    with pytest.raises(InputError, match="nothing to join"):
        concatenate([])
    with pytest.raises(InputError, match=r"motor_current_A: is present in some parts"):
        concatenate([samples(), samples(motor_current_A=np.zeros(10))])


# ---- the slot grid ---------------------------------------------------------------------------------------------------

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


@pytest.mark.parametrize(("seconds", "expected"), [(0.125, 125_000_000), (0.005, 5_000_000), (1 / 3, 333_333_333)])
def test_period_in_nanoseconds(seconds, expected):
    assert period_ns(seconds) == expected
