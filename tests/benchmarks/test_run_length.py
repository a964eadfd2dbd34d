"""The average run length in closed form against the paper's figures and against the laws it rests on."""

import numpy as np
import pytest

from benchmarks.paper.run_length import (
    LONGEST_RUN,
    PAPER_RUN_LENGTHS,
    PAPER_WEIGHTS,
    SLOPE_ERRORS,
    acceleration_of_the_paper,
    run_length,
    simulate_run_length,
    true_missed,
    true_run_length,
)


def test_one_acceleration_explains_both_of_the_paper_s_figures() -> None:
    fitted = acceleration_of_the_paper()
    weak, _, strong = PAPER_WEIGHTS
    assert run_length(20, weak, fitted) == pytest.approx(PAPER_RUN_LENGTHS[weak], rel=1e-3)
    # Not fitted: the paper rounds to a power of ten; errata 3 computes 6e9 where the slope is known.
    assert np.log10(run_length(20, strong, fitted)) == pytest.approx(np.log10(PAPER_RUN_LENGTHS[strong]), abs=0.5)


@pytest.mark.parametrize("weight", PAPER_WEIGHTS)
@pytest.mark.parametrize("w", [10, 20, 40])
def test_the_simulation_agrees_with_the_law_that_the_statistic_has(weight: float, w: int) -> None:
    """On both sides, within five standard errors; χ², which the paper uses, is another law."""
    fitted = acceleration_of_the_paper()
    found = simulate_run_length(weight, fitted, 7, w)
    missed, rate = found.missed, 1.0 / found.run_length.value
    assert abs(true_missed(w, weight, fitted) - missed.value) < 2.5 * (missed.value - missed.low)
    expected = true_run_length(w, weight, fitted)
    if expected < 0.99 * LONGEST_RUN:
        assert abs(1.0 / expected - rate) < 2.5 * (1.0 / found.run_length.low - rate)
    assert found.alarm_run_length.value > found.run_length.value


def test_an_error_of_the_slope_shortens_the_run_and_hides_jumps() -> None:
    weight, acceleration = PAPER_WEIGHTS[-1], 5e-5
    lengths = [true_run_length(20, weight, acceleration, error) for error in SLOPE_ERRORS]
    missed = [true_missed(20, weight, acceleration, error) for error in SLOPE_ERRORS]
    assert (np.diff(lengths) < 0).all()
    assert (np.diff(missed) > 0).all()
