"""Sensors, noise, temperature and faults."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from rwa_monitor.simulation.record import bearing_temperature, measure
from rwa_monitor.simulation.scenario import FrictionNoise

N = 100_000


def autocorrelation(values, lag):
    centred = values - values.mean()
    return np.mean(centred[lag:] * centred[:-lag]) / np.mean(centred**2)


@pytest.mark.parametrize(
    "noise",
    [
        FrictionNoise(),
        FrictionNoise(law="ar1", ar_coefficient=0.5),
        FrictionNoise(law="student_t", degrees_of_freedom=5),
    ],
    ids=["white", "ar1", "student_t"],
)
def test_every_noise_law_has_the_stated_standard_deviation(noise):
    drawn = noise.draw(2.0, N, np.random.default_rng(0))
    assert drawn.std() == pytest.approx(2.0, rel=0.03)
    assert abs(drawn.mean()) < 5 * noise.long_run_std(2.0) / np.sqrt(N)
    blocks = drawn.reshape(-1, 500).mean(axis=1)
    assert blocks.std() * np.sqrt(500) == pytest.approx(noise.long_run_std(2.0), rel=0.25)


def test_ar1_has_its_coefficient_and_begins_in_its_stationary_law():
    noise = FrictionNoise(law="ar1", ar_coefficient=0.8)
    drawn = noise.draw(1.0, N, np.random.default_rng(1))
    for lag in (1, 2, 5):
        assert autocorrelation(drawn, lag) == pytest.approx(0.8**lag, abs=0.03)
    first = [noise.draw(1.0, 2, np.random.default_rng(seed))[0] for seed in range(3_000)]
    assert stats.kstest(first, "norm").pvalue > 1e-5


def test_a_sensor_rounds_to_its_quantum_after_its_noise():
    true = np.linspace(-1, 1, N)
    reading = measure(true, 0.05, 0.01, np.random.default_rng(3))
    assert np.allclose(reading / 0.01, np.rint(reading / 0.01), atol=1e-9)
    assert np.std(reading - true) == pytest.approx(np.hypot(0.05, 0.01 / np.sqrt(12)), rel=0.02)
    assert np.array_equal(measure(true, 0.0, 0.0, np.random.default_rng(3)), true)


def test_temperature_swings_with_the_orbit_and_follows_dissipation_with_a_lag():
    time = np.arange(80_000) * 0.125
    idle = bearing_temperature(time, np.zeros(time.size), np.random.default_rng(4))
    assert 1.0 <= np.ptp(idle) <= 5.0
    assert 10.0 < idle.mean() < 30.0
    power = np.where(time < 5_000.0, 0.0, 1.0)
    warm = bearing_temperature(time, power, np.random.default_rng(4)) - idle
    balance = 2.0 * power.mean()
    expected = np.where(
        time < 5_000.0,
        balance * np.exp(-time / 1200.0),
        2.0 + (balance * np.exp(-5_000.0 / 1200.0) - 2.0) * np.exp(-(time - 5_000.0) / 1200.0),
    )
    assert warm == pytest.approx(expected, abs=1e-3)
