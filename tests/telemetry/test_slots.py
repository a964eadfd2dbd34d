"""Slots: the ring buffer against a dictionary that keeps everything; temperature held between its readings."""

from itertools import pairwise

import hypothesis.strategies as st
import numpy as np
from hypothesis import given

from rwa_monitor.samples import FloatArray
from rwa_monitor.telemetry.slots import DRIFT_K_S, STUCK_S, RingBuffer, held_temperature
from rwa_monitor.wheel.effects.drag_laws import SEASON_K

CAPACITY = 13


@given(
    steps=st.lists(st.lists(st.booleans(), min_size=1, max_size=CAPACITY), max_size=12),
    begin=st.integers(0, 30),
    values_capacity=st.integers(1, CAPACITY),
)
def test_it_holds_the_last_slots_and_fewer_values(steps: list[list[bool]], begin: int, values_capacity: int) -> None:
    ring, again = RingBuffer(CAPACITY, (), values_capacity), RingBuffer(CAPACITY, (), values_capacity)
    ring.clear(begin)
    reference: dict[int, float] = {}
    for filled in (step[:values_capacity] for step in steps):
        slots = ring.end + np.flatnonzero(filled)
        values = len(reference) + np.arange(slots.size, dtype=np.float64)
        reference.update(zip(slots.tolist(), values.tolist(), strict=True))
        ring.extend(ring.end + len(filled), slots, {"speed_rad_s": values, "torque_Nm": -values})
    low, high = ring.begin - 5, ring.end + 5
    asked, held = np.arange(low, high), np.arange(ring.begin, ring.end)
    assert ring.begin == max(begin, ring.end - CAPACITY)
    assert ring.values_begin == max(begin, ring.end - values_capacity)
    there = [slot in reference and slot >= ring.begin for slot in asked.tolist()]
    expected = [reference.get(slot, np.nan) if slot >= ring.values_begin else np.nan for slot in asked.tolist()]
    kept = {name: ring.read(name, ring.values_begin, ring.end) for name in ring.channels}
    again.restore(ring.begin, ring.is_filled(held), kept)
    for one in (ring, again):
        np.testing.assert_array_equal(one.read("speed_rad_s", low, high), expected)
        np.testing.assert_array_equal(one.read("torque_Nm", low, high), np.negative(expected))
        np.testing.assert_array_equal(one.is_filled(asked), there)


# ---- the bearing's temperature between its readings ------------------------------------------------------------------


PERIOD_S = 0.125
SLOTS = 8000


def held(measured: FloatArray, cuts: list[int] | None = None) -> tuple[FloatArray, FloatArray]:
    """Return temperature and error of a record that comes in pieces."""
    memory, found = None, []
    for start, stop in pairwise([0, *sorted(cuts or []), measured.size]):
        temperature, error, memory = held_temperature(measured[start:stop], PERIOD_S, 20.0, memory)
        found.append((temperature, error))
    return tuple(map(np.concatenate, zip(*found, strict=True)))


def swinging(digits_K: float = 0.0) -> FloatArray:
    """Return a temperature that swings by ±3 K, with a sensor's noise, or in coarse digits."""
    true = 20.0 + 3.0 * np.sin(2.0 * np.pi * np.arange(SLOTS) * PERIOD_S / 5700.0)
    noisy = true + 0.02 * np.random.default_rng(3).standard_normal(SLOTS)
    return digits_K * np.rint(noisy / digits_K) if digits_K else noisy


@given(
    values=st.lists(st.sampled_from([np.nan, 20.0, 20.5, 21.0, -273.15]), min_size=1, max_size=60),
    repeated=st.integers(1, 60),
    cuts=st.lists(st.integers(0, 3600), max_size=8),
)
def test_it_is_the_same_in_any_pieces(values: list[float], repeated: int, cuts: list[int]) -> None:
    measured = np.repeat(values, repeated)
    whole, pieces = held(measured), held(measured, [min(cut, measured.size) for cut in cuts])
    np.testing.assert_array_equal(whole[0], pieces[0])
    np.testing.assert_array_equal(whole[1], pieces[1])


def test_a_gap_is_held_and_its_error_grows() -> None:
    measured = swinging()
    measured[1000:1480] = np.nan  # a minute
    temperature, error = held(measured)
    np.testing.assert_array_equal(temperature[1000:1480], measured[999])
    assert error[999] == error[1480] == 0.0
    np.testing.assert_allclose(error[1000:1480], DRIFT_K_S * PERIOD_S * np.arange(1, 481))


def test_what_no_bearing_has_is_missing() -> None:
    measured = swinging()
    measured[500:510] = -273.15  # a broken wire
    temperature, error = held(measured)
    np.testing.assert_array_equal(temperature[500:510], measured[499])
    assert (error[500:510] > 0.0).all()


def test_before_the_first_reading_nothing_is_known() -> None:
    measured = swinging()
    measured[:100] = np.nan
    temperature, error = held(measured)
    assert (temperature[:100] == 20.0).all()
    assert (error[:100] == SEASON_K).all()
    assert error[100] == 0.0


def test_a_restless_channel_that_repeats_one_value_is_as_old_as_that() -> None:
    measured = swinging()
    measured[3000:] = measured[3000]
    _, error = held(measured)
    since_s = PERIOD_S * (np.arange(SLOTS) - 3000)
    assert (error[since_s <= STUCK_S] == 0.0).all()
    late = since_s > STUCK_S
    np.testing.assert_allclose(error[late], np.minimum(DRIFT_K_S * since_s[late], SEASON_K))


def test_coarse_digits_and_a_quiet_bearing_are_believed() -> None:
    assert (held(swinging(digits_K=0.5))[1] == 0.0).all()
    assert (held(np.full(SLOTS, 20.0))[1] == 0.0).all()
