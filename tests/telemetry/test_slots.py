"""The bearing's temperature in every slot: held between its readings, with an error that grows."""

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.telemetry.slots import DRIFT_K_S, LARGEST_ERROR_K, STUCK_S, held_temperature

PERIOD_S = 0.125
SLOTS = 8000


def held(measured: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return temperature and error of a record."""
    return held_temperature(measured, PERIOD_S, 20.0, None)[:2]


def swinging(digits_K: float = 0.0) -> FloatArray:
    """Return a temperature that swings by ±3 K, with a sensor's noise, or in coarse digits."""
    true = 20.0 + 3.0 * np.sin(2.0 * np.pi * np.arange(SLOTS) * PERIOD_S / 5700.0)
    noisy = true + 0.02 * np.random.default_rng(3).standard_normal(SLOTS)
    return digits_K * np.rint(noisy / digits_K) if digits_K else noisy


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
    assert (error[:100] == LARGEST_ERROR_K).all()
    assert error[100] == 0.0


def test_a_restless_channel_that_repeats_one_value_is_as_old_as_that() -> None:
    measured = swinging()
    measured[3000:] = measured[3000]
    _, error = held(measured)
    since_s = PERIOD_S * (np.arange(SLOTS) - 3000)
    assert (error[since_s <= STUCK_S] == 0.0).all()
    late = since_s > STUCK_S
    np.testing.assert_allclose(error[late], np.minimum(DRIFT_K_S * since_s[late], LARGEST_ERROR_K))


def test_coarse_digits_and_a_quiet_bearing_are_believed() -> None:
    assert (held(swinging(digits_K=0.5))[1] == 0.0).all()
    assert (held(np.full(SLOTS, 20.0))[1] == 0.0).all()
