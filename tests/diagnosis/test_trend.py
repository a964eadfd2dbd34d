"""The trend over windows: false alarms and coverage counted on simulated courses, invariances, refusals."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from rwa_monitor.diagnosis.trend import SIGNIFICANCE, Trend, find_trend
from rwa_monitor.errors import InputError
from rwa_monitor.simulation.datasets import FLEET_ONSET, FLEET_SEVERITIES, FLEET_WINDOWS

WINDOW_S = 10_000.0
Scatter = Callable[[int, np.random.Generator], np.ndarray]


def middles(windows: int) -> np.ndarray:
    return (np.arange(windows) + 0.5) * WINDOW_S


def drawn_std(windows: int, rng: np.random.Generator) -> np.ndarray:
    """Draw the deviations that the estimates state: they differ from window to window, as those of real windows."""
    return np.exp(rng.normal(0.0, 0.5, windows))


def nothing(windows: int, rng: np.random.Generator) -> np.ndarray:
    return np.zeros(windows)


def remembered(windows: int, rng: np.random.Generator) -> np.ndarray:
    """Scatter of 2 deviations with a memory of 0.6 from one window to the next."""
    steps = 0.8 * rng.standard_normal(windows + 100)
    return 2.0 * signal.lfilter([1.0], [1.0, -0.6], steps)[100:]


def grossly_wrong(windows: int, rng: np.random.Generator) -> np.ndarray:
    """Errors of 50 deviations in 3 % of the windows."""
    return np.where(rng.random(windows) < 0.03, 50.0 * rng.standard_normal(windows), 0.0)


@pytest.mark.parametrize("scatter", [nothing, remembered, grossly_wrong])
def test_courses_without_a_trend_are_announced_no_oftener_than_stated(scatter: Scatter) -> None:
    rng = np.random.default_rng(41)
    courses, windows, level = 150, 20, 0.01
    announced = 0
    for _ in range(courses):
        std = drawn_std(windows, rng)
        found = find_trend(middles(windows), 100.0 + std * rng.standard_normal(windows) + scatter(windows, rng), std)
        announced += found.p_value < level
    # Three standard errors of a binomial count above its mean.
    assert announced <= courses * level + 3 * np.sqrt(courses * level)


def fleet_course(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    """Return values and deviations of a wheel of the recipe `fleet` whose dry friction grows, and when it is 1.3."""
    life = FLEET_WINDOWS * WINDOW_S
    onset = life * rng.uniform(*FLEET_ONSET)
    slope = (FLEET_SEVERITIES["dry"] - 1.0) / (life - onset)
    std = 0.01 * drawn_std(FLEET_WINDOWS, rng)
    truth = 1.0 + slope * np.maximum(middles(FLEET_WINDOWS) - onset, 0.0)
    return truth + std * rng.standard_normal(FLEET_WINDOWS), std, onset + 0.3 / slope


def test_the_interval_of_the_time_to_a_limit_holds_it_as_often_as_stated() -> None:
    rng = np.random.default_rng(42)
    announced = held = 0
    for _ in range(120):
        value, std, truth = fleet_course(rng)
        seen = 16
        found = find_trend(middles(FLEET_WINDOWS)[:seen], value[:seen], std[:seen])
        reach = found.reach(1.3)
        if reach is not None:
            announced += 1
            held += reach.low_s <= truth <= reach.high_s
    assert announced > 70
    # 95 % intervals: three standard errors below.
    assert held / announced > 0.95 - 3 * np.sqrt(0.95 * 0.05 / announced)


def test_a_growth_is_found_with_its_slope_and_its_beginning() -> None:
    rng = np.random.default_rng(43)
    std = np.full(40, 0.01)
    truth = 1.0 + 0.02 * np.maximum(np.arange(40) - 20.0, 0.0)
    found = find_trend(middles(40), truth + std * rng.standard_normal(40), std)
    assert found.present
    assert found.p_value < 1e-12
    assert abs(found.slope - 0.02 / WINDOW_S) < 4 * found.slope_std
    assert found.slope_std < 0.05 * found.slope
    low, _, high = found.onset_s
    assert low - WINDOW_S <= 20.5 * WINDOW_S <= high + WINDOW_S
    _, value_std = found.lines.at(middles(40)[-1:])
    assert abs(found.value - truth[-1]) < 4 * value_std[0]


def same(one: Trend, other: Trend, *, slope: float = 1.0) -> None:
    assert other.p_value == pytest.approx(one.p_value, rel=1e-6)
    assert other.slope == pytest.approx(slope * one.slope, rel=1e-6)
    assert other.slope_std == pytest.approx(abs(slope) * one.slope_std, rel=1e-6)


@settings(max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    shift=st.floats(-100.0, 100.0),
    scale=st.sampled_from([-3.0, 1e-6, 0.5]),
    clock=st.sampled_from([1e-3, 1.0, 86_400.0]),
)
def test_units_zero_points_and_sign_change_nothing_else(seed: int, shift: float, scale: float, clock: float) -> None:
    rng = np.random.default_rng(seed)
    std = drawn_std(15, rng)
    value = 10.0 + std * rng.standard_normal(15) + np.maximum(np.arange(15) - 7.0, 0.0)
    one = find_trend(middles(15), value, std)
    other = find_trend(clock * middles(15) + 7.0, scale * (value + shift), abs(scale) * std)
    same(one, other, slope=scale / clock)


def test_windows_that_show_nothing_are_left_out() -> None:
    rng = np.random.default_rng(44)
    std = drawn_std(20, rng)
    value = 5.0 + std * rng.standard_normal(20)
    hidden = np.array([3, 9, 10])
    gone = np.delete(np.arange(20), hidden)
    less = find_trend(middles(20)[gone], value[gone], std[gone])
    value[hidden], std[hidden[:1]] = np.nan, np.nan
    more = find_trend(middles(20), value, std)
    assert more.windows == 17
    same(less, more)


def test_a_limit_that_is_passed_is_reached_now_and_one_behind_never() -> None:
    std = np.full(20, 0.01)
    found = find_trend(middles(20), 1.0 + 0.05 * np.arange(20), std)
    passed = found.reach(1.5)
    assert passed.low_s == passed.time_s == passed.high_s == middles(20)[-1]
    ahead = found.reach(3.0)
    assert ahead.low_s <= ahead.time_s <= ahead.high_s
    assert ahead.time_s == pytest.approx(40.5 * WINDOW_S, rel=0.01)
    falling = find_trend(middles(20), 1.0 - 0.05 * np.arange(20), std)
    below = falling.reach(-0.5)
    assert below.time_s == pytest.approx(30.5 * WINDOW_S, rel=0.01)


def test_without_a_trend_there_is_no_time_to_a_limit() -> None:
    found = find_trend(middles(20), np.tile([1.0, 1.1], 10), np.full(20, 0.1))
    assert found.p_value > SIGNIFICANCE
    assert found.reach(1.2) is None


@pytest.mark.parametrize(
    ("time_s", "std"),
    [(np.zeros(10), np.ones(10)), (middles(10), np.zeros(10)), (middles(9), np.ones(10))],
    ids=["no order", "exact", "lengths"],
)
def test_input_that_makes_no_sense_is_refused(time_s: np.ndarray, std: np.ndarray) -> None:
    with pytest.raises(InputError, match="trend"):
        find_trend(time_s, np.ones(10), std)
