"""Jumps as the score places them, exactly, for every sample; and effects that a few samples decide."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from rwa_monitor.discrepancy.base_fit import Fit
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.likelihood import NO_JUMPS, NoiseLaw, Series
from rwa_monitor.discrepancy.score import Background, wald, with_law
from rwa_monitor.discrepancy.shape_profile import middle_shape
from rwa_monitor.discrepancy.terms import Model, Term, make_term
from rwa_monitor.wheel.effects.asymmetry import TorqueBias, ViscousAsymmetry
from rwa_monitor.wheel.effects.base import MeanEffect
from rwa_monitor.wheel.effects.drag_laws import QuadraticDrag, SublinearViscous
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


def test_a_term_is_screened_as_it_is_scored_where_nothing_is_averaged() -> None:
    problem = problem_of(record(swing(8000), jumps=(3000,))[0])
    base = Fitting(problem, jumps=True).base()
    term = make_term(problem, QuadraticDrag, {}, None)
    law = NoiseLaw()
    screened = Background.of(problem, (), law, base.fit.jumps).criterion_with(term)
    assert screened == pytest.approx(with_law(problem, (term,), base.fit.jumps, law).score, abs=1e-6)


def test_screening_averages_neighbours_of_one_recording() -> None:
    problem = problem_of(*(record(swing(size), jumps=())[0] for size in (1000, 1501)))
    means, averaging = Series.of(problem).averaged(problem.size // 7)
    column = np.random.default_rng(5).normal(size=problem.size)
    pieces = [column[a:b] for a, b in pairwise(problem.starts.tolist())]
    width = -(-problem.size // (problem.size // 7))
    expected = [piece[i : i + width].mean() for piece in pieces for i in range(0, piece.size, width)]
    np.testing.assert_allclose(averaging @ column, expected, rtol=1e-12, atol=1e-14)
    assert means.size == len(expected)


def test_a_jump_at_a_change_of_direction_is_one_of_the_next_mean_that_has_a_direction() -> None:
    problem = problem_of(record(swing(8000), jumps=())[0])
    turns = np.flatnonzero(np.diff(problem.sign)) + 1
    turns = turns[turns % 2 == 1]  # within a mean of two samples
    assert turns.size
    means, _ = Series.of(problem, turns).averaged(problem.size // 2)
    assert np.count_nonzero(means.sign == 0.0) >= turns.size
    assert means.jumps.size == turns.size
    assert np.all(means.sign[means.jumps] != 0.0)
    term = make_term(problem, QuadraticDrag, {}, None)
    assert np.isfinite(means.whitened(means.friction, NoiseLaw())[0]).all()
    assert np.isfinite(Background.of(problem, (), NoiseLaw(), turns).criterion_with(term))


def test_a_motion_that_only_reverses_is_searched() -> None:
    speed = 50.0 * np.where(np.arange(600) // 3 % 2 == 0, 1.0, -1.0)
    result = find_discrepancy([("to and fro", record(speed, jumps=())[0])], WHEEL).result
    assert result.gain.changepoints_extended == 0


@pytest.mark.parametrize(("share", "low", "high"), [(1.0, 50.0, 120.0), (0.02, 0.0, 8.0)])
def test_what_a_few_samples_decide_gains_as_much_and_does_not_stand_out(share: float, low: float, high: float) -> None:
    problem = problem_of(record(swing(8000), jumps=())[0])
    column = np.random.default_rng(3).choice((-1.0, 1.0), problem.size)
    torque = np.where(np.arange(problem.size) < share * problem.size, 0.1 * NOISE_NM / share * column, 0.0)
    problem = replace(problem, z=problem.z + torque)
    term = Term(TorqueBias, {}, column[:, None], np.array([-np.inf]), np.array([np.inf]), 1.0)
    base, model = (with_law(problem, terms, NO_JUMPS, NoiseLaw()) for terms in ((), (term,)))
    assert 50.0 < base.score - model.score + problem.log_size < 120.0  # twice the log-likelihood: a hundredth a sample
    assert low < wald(problem, model)[0] < high


@pytest.mark.parametrize(
    ("small", "large", "reverses", "minor"),
    [
        (QuadraticDrag, SublinearViscous, True, True),
        (ViscousAsymmetry, SublinearViscous, True, False),
        (SublinearViscous, ViscousAsymmetry, True, False),
        (ViscousAsymmetry, SublinearViscous, False, True),
    ],
)
def test_an_inexact_law_explains_what_is_small_beside_it_but_not_what_has_the_other_symmetry(
    small: type[MeanEffect], large: type[MeanEffect], reverses: bool, minor: bool
) -> None:
    speed = swing(6000)
    problem = problem_of(record(speed if reverses else np.abs(speed) + 1.0, jumps=())[0])
    terms, strengths = [], []
    for effect, size in ((small, 0.005), (large, 1.0)):
        term = make_term(problem, effect, middle_shape(problem, effect), None)
        terms.append(term)
        strengths.append(size / float(np.abs(term.columns).max()))
    nothing = np.zeros(problem.size)
    fit = Fit(NO_JUMPS, np.array([0.0, *strengths]), nothing, nothing)
    model = Model(tuple(terms), fit, NoiseLaw(), 0.0)
    assert model.is_minor(0, problem.sign) == minor
    assert not model.is_minor(1, problem.sign)
