"""The trend of a coefficient in words and with its limit: at any time, and from windows in any order."""

import numpy as np

import rwa_monitor as rwa
from rwa_monitor.reporting.diagnoses import CoefficientTrend, EstimateRecord, coefficient_trend
from tests.history.support import diagnosis

WINDOW_NS = 10_000 * 10**9
GROWTH_NM, STD_NM = 3.2e-5, 8e-6  # a window


def trend_from(begin_ns: int, limit_at: int = 30) -> CoefficientTrend:
    """Return the trend of 20 windows of growing friction, of which the limit is that of a later or earlier one."""
    value = 1.6e-3 + GROWTH_NM * np.arange(20) + STD_NM * np.random.default_rng(4).standard_normal(20)
    estimates = [
        EstimateRecord(
            window_start_ns=begin_ns + number * WINDOW_NS,
            window_end_ns=begin_ns + (number + 1) * WINDOW_NS,
            value=one,
            std=STD_NM,
            nominal_low=None,
            nominal_high=1.6e-3 + GROWTH_NM * limit_at,
            unit="N m",
            name="dry",
            probability=0.0,
            severity=None,
            active=False,
        )
        for number, one in enumerate(value.tolist())
    ]
    return coefficient_trend("dry", estimates)


def test_a_growth_and_when_it_reaches_its_limit_are_stated_and_times_since_1970_lose_nothing() -> None:
    plain, late = trend_from(0), trend_from(1_800_000_000_123_456_789)
    assert plain.reach.low_s <= 30.5 * WINDOW_NS * 1e-9 <= plain.reach.high_s
    assert plain.sentence().startswith("Base dry friction grows by ")
    assert "and reaches its limit of 2.56 mN m in" in plain.sentence()
    assert late.reach == plain.reach
    assert late.sentence() == plain.sentence()
    assert trend_from(0, 10).sentence().endswith("and is beyond its limit of 1.92 mN m.")
    assert "and is far from its limit of " in trend_from(0, 10**6).sentence()


def test_diagnoses_in_any_order_give_the_same() -> None:
    diagnoses = [diagnosis(number, severity=1.0 if number > 5 else None) for number in range(8)]
    forth, back = rwa.wheel_trends(diagnoses), rwa.wheel_trends(diagnoses[::-1])
    assert list(forth) == list(diagnoses[0].anomalies)
    assert [t.sentence() for t in forth.values()] == [back[name].sentence() for name in forth]
    assert rwa.wheel_trends(diagnoses, {"viscous": 1.0})["viscous"].limit == 1.0
    assert rwa.wheel_trends([]) == {}
