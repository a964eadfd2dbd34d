"""What no effect explains: a level that creeps is no switching system, and many true jumps are no creeping."""

import numpy as np
import pytest
from scipy import signal

from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.unexplained import with_free_curves
from rwa_monitor.wheel.wheel import Wheel
from tests.discrepancy.simple import NOISE_NM, PERIOD_S, WHEEL, record, swing
from tests.discrepancy.smooth import null_record, problem_of

COUNT = 8000
# A wheel of which no switching system is known, as one that has just been put on the bench.
UNKNOWN: Wheel = WHEEL.model_copy(update={"fss": ()})


@pytest.mark.parametrize("forgets_after", [150, 600])  # slots
def test_a_drag_that_wanders_is_not_explained_away_by_noise_or_small_steps(forgets_after: int) -> None:
    kept = np.exp(-1 / forgets_after)
    draws = np.random.default_rng(3).normal(size=COUNT)
    walk = 3 * NOISE_NM * np.sqrt(1 - kept**2) * signal.lfilter([1.0], [1.0, -kept], draws)

    def wandering(speed: np.ndarray, level: np.ndarray) -> np.ndarray:
        return walk * np.sign(speed)

    samples, _ = record(swing(COUNT), jumps=(), effect=wandering)
    result = find_discrepancy([("wandering", samples)], UNKNOWN).result
    assert result.verdict == "inadequate"
    assert "wanders" in result.unexplained.signature
    assert 0.4 * walk.std() < result.unexplained.size_Nm < 1.1 * walk.std()


@pytest.mark.parametrize("autocorrelation", [0.5, 0.95])
def test_noise_that_forgets_is_no_wandering(autocorrelation: float) -> None:
    white = np.sqrt(1 - autocorrelation**2) * np.random.default_rng(4).normal(size=COUNT)
    noise = NOISE_NM * signal.lfilter([1.0], [1.0, -autocorrelation], white)
    samples, _ = record(swing(COUNT), jumps=(), noise=noise)
    assert find_discrepancy([("noise", samples)], UNKNOWN).result.unexplained is None


def test_many_true_jumps_are_no_wandering() -> None:
    samples, _ = record(swing(COUNT), jumps=tuple(range(500, 7600, 600)))
    result = find_discrepancy([("jumps", samples)], UNKNOWN).result
    assert result.unexplained is None
    assert result.gain.changepoints_extended == 12


def test_a_drift_that_grows_ever_faster_is_not_explained_away_by_jumps() -> None:
    count = 20_000
    time_s = np.arange(count) * PERIOD_S
    ramp = 3.0e-4 * np.clip((time_s - 1000.0) / 1500.0, 0.0, None) ** 2
    jumps = (6000, 11_000, 16_500)
    samples, _ = record(swing(count), jumps=jumps, effect=lambda speed, level: ramp * np.sign(speed))
    result = find_discrepancy([("ramp", samples)], WHEEL).result
    assert result.verdict == "inadequate"
    assert "drifts with time" in result.unexplained.signature
    beside_levels = np.concatenate([part - part.mean() for part in np.split(ramp, jumps)])
    assert result.unexplained.size_Nm == pytest.approx(beside_levels.std(), rel=0.1)


def test_the_period_of_a_short_rub_is_reported_not_that_of_a_harmonic() -> None:
    count = 20_000
    rub = 2 * NOISE_NM * (np.mod(np.arange(count) * PERIOD_S, 130.0) < 6.0)
    samples, _ = record(swing(count), effect=lambda speed, level: rub * np.sign(speed))
    result = find_discrepancy([("rub", samples)], WHEEL).result
    assert "periodic in time, every 130 s" in result.unexplained.signature
    assert 0.6 * rub.std() < result.unexplained.size_Nm < 1.5 * rub.std()


def test_a_short_record_that_wanders_is_periodic_with_nothing_longer_than_itself() -> None:
    samples = null_record("two sines", 0.999, seed=8)
    fitting = Fitting(problem_of(samples), jumps=False)
    periods = [
        1.0 / model.terms[-1].shape["frequency_Hz"]
        for model in with_free_curves(fitting, fitting.base())
        if "frequency_Hz" in model.terms[-1].shape
    ]
    assert len(periods) == 3
    assert max(periods) < len(samples) * PERIOD_S / 4.0


def test_what_repeats_with_the_motion_is_not_called_periodic_in_time() -> None:
    speed = swing(period_s=170.0)
    bend = 3 * NOISE_NM * np.sin(speed / 10.0)  # no law of the catalogue
    samples, _ = record(speed, jumps=(), effect=lambda speed, level: bend * np.sign(speed))
    result = find_discrepancy([("bend", samples)], WHEEL).result
    assert result.verdict == "inadequate"
    assert "periodic in time" not in (result.unexplained.signature if result.unexplained else "")
