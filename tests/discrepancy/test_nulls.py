"""p-values from the table of nulls: never zero, falling with the gain, and uniform where nothing is missing.

The table is made from records of the package's own simulator; here it is judged on those of the blind suite, which
draws wheels, scales, motions and noise by a program of its own.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from benchmarks.blind.generator import MANOEUVRES, NOISES, generate, plan
from benchmarks.nulls import best_gain, null_gains
from rwa_monitor.discrepancy.explanation import prepare
from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.hypotheses import CANDIDATES
from rwa_monitor.discrepancy.p_values import Nulls, built_in_null_distribution
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.wheel.effects.base import Family

FAMILIES: tuple[Family, ...] = ("mean", "noise", "switching")
FRESH = 36  # null records: four for each motion and noise
SEED = 640_000  # of no development or validation run


@given(
    family=st.sampled_from(FAMILIES),
    gain=st.floats(-50, 1e6),
    more=st.floats(0, 1e6),
    log_size=st.floats(5.0, 14.0),
    derived=st.booleans(),
)
def test_a_p_value_is_a_probability_that_falls_with_the_gain_and_is_never_zero(
    family: Family, gain: float, more: float, log_size: float, derived: bool
) -> None:
    table = built_in_null_distribution()
    p = table.p_value(family, gain, log_size, derived=derived)
    assert 0.0 < min(nulls.floor for nulls in table.families[family, derived]) <= p <= 1.0
    assert table.p_value(family, gain + more, log_size, derived=derived) <= p


def test_the_tail_goes_on_where_the_count_ends_and_stops_where_it_is_no_longer_trusted() -> None:
    # Of exponential nulls with mean 3 the true p-value is exp(-x/3). A count of m is known to 1/√m; the largest of
    # 1,000 to an e-fold or two, and the scale, a median of 100, to 1.44/√100.
    nulls = Nulls(8.0, np.sort(np.random.default_rng(5).exponential(3.0, 1000)))
    for statistic in (1.0, 3.0, 9.0):
        expected = float(np.exp(-statistic / 3))
        assert nulls.p_value(statistic) == pytest.approx(expected, rel=3 / np.sqrt(1000 * expected))
    largest = float(nulls.statistics[-1])
    assert nulls.p_value(largest) == pytest.approx(nulls.p_value(largest + 1e-9)) == pytest.approx(2 / 1001)
    assert nulls.scale == pytest.approx(3.0, rel=3 * 0.144)
    assert abs(np.log(nulls.p_value(largest + 9.0) / np.exp(-(largest + 9.0) / 3))) < 3.0
    assert nulls.p_value(1e9) == nulls.floor == pytest.approx(1 / (100 * 1001))


def test_the_table_is_what_its_command_makes() -> None:
    """One record of it, made again: the table belongs to this search and not to an earlier one."""
    again = null_gains(1_500, "rich", "white", 0)
    (_, middle, _) = built_in_null_distribution().families["mean", False]
    assert np.min(np.abs(middle.statistics - round(again["mean"], 2))) < 0.02


def test_p_values_are_uniform_where_nothing_is_missing() -> None:
    p_values = []
    for k in range(FRESH):
        case = replace(plan("null", (), k, SEED + k), manoeuvre=MANOEUVRES[k % 3], noise=NOISES[k // 3 % 3])
        samples, wheel, _ = generate(case)
        problem = prepare([make_record(samples[slice(0, 2_000)], wheel, "null")], wheel)
        _, gain = best_gain(Fitting(problem, jumps=True), CANDIDATES)
        of_family = built_in_null_distribution().families["mean", False]
        p_values.append(of_family[1].p_value(gain + problem.log_size))
    # Both ways, at one in a thousand: p-values too small would name too much, too large ones would hide effects.
    test = stats.kstest(p_values, "uniform")
    assert test.pvalue > 1e-3, sorted(np.round(p_values, 3))
