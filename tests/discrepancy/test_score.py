"""Jumps as the score places them: exactly, for every sample, and with care beside a change of direction."""

from __future__ import annotations

import numpy as np
import pytest

from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.fitting import Fitting
from tests.discrepancy.simple import NOISE_NM, WHEEL, record, swing
from tests.discrepancy.smooth import problem_of


def test_pulses_of_three_samples_are_jumps() -> None:
    speed = swing(8000)
    begins = np.arange(300, 7900, 400)
    begins = begins[np.abs(speed[begins]) > 20.0]
    pulses = np.zeros(speed.size)
    pulses[(begins[:, None] + np.arange(3)).ravel()] = 8.0 * NOISE_NM
    samples, _ = record(speed, jumps=(), effect=lambda speed, _: np.sign(speed) * pulses)
    problem = problem_of(samples)
    found = problem.slot[Fitting(problem, jumps=True).base().fit.jumps]
    edges = np.concatenate([begins, begins + 3])
    assert np.mean(np.isin(edges, found)) > 0.9  # a pulse at eight deviations is worth 190; two jumps cost 54


@pytest.mark.parametrize("offset", [-3, 0, 2])
def test_a_jump_beside_a_reversal_is_placed_to_the_sample(offset: int) -> None:
    speed = swing(8000)
    crossing = int(np.flatnonzero(np.diff(np.sign(speed)) != 0)[2]) + 1
    samples, _ = record(speed, jumps=(crossing + offset,))
    problem = problem_of(samples)
    jumps = problem.slot[Fitting(problem, jumps=True).base().fit.jumps]
    assert jumps.size == 1
    assert abs(int(jumps[0]) - crossing - offset) <= 1  # the samples about zero are at rest


def test_a_motion_that_only_reverses_is_searched() -> None:
    speed = 50.0 * np.where(np.arange(600) // 3 % 2 == 0, 1.0, -1.0)
    result = find_discrepancy([("to and fro", record(speed, jumps=())[0])], WHEEL).result
    assert result.gain.changepoints_extended == 0
