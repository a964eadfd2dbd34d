"""Switching systems against their laws."""

import itertools

import numpy as np
import pytest
from scipy import stats

from rwa_monitor.errors import InputError
from rwa_monitor.wheel.durations import Geometric, Lognormal, Uniform, Weibull
from rwa_monitor.wheel.switching_systems import (
    jumping_chain_law,
    residual_duration,
    simulate_system,
    time_law,
)
from rwa_monitor.wheel.wheel import FrictionRange, SwitchingSystem


def system(durations, up=None, friction=True):
    ranges = tuple(FrictionRange(low=float(q), high=q + 0.5) for q in range(len(durations)))
    return SwitchingSystem(name="s", durations=durations, friction=ranges if friction else None, up=up)


SYSTEMS = {
    "two": system((Uniform(low=20, high=60), Uniform(low=1, high=10))),
    "three": system((Uniform(low=5, high=15), Geometric(mean=20), Weibull(shape=1.5, scale=12))),
    "four, mostly up": system(
        (Lognormal(mu=2.0, sigma=0.4), Uniform(low=3, high=9), Geometric(mean=4), Uniform(low=10, high=30)),
        up=(1.0, 0.7, 0.8, 0.0),
    ),
}
systems = pytest.mark.parametrize("fss", SYSTEMS.values(), ids=SYSTEMS.keys())


def test_chain_that_never_returns_forgets_its_start():
    fss = system((Geometric(mean=5),) * 3, up=(1.0, 1.0, 0.0))
    assert jumping_chain_law(fss) == pytest.approx([0.0, 0.5, 0.5])


@pytest.mark.parametrize("law", [Uniform(low=3, high=9), Geometric(mean=4.0), Weibull(shape=1.5, scale=8.0)])
def test_residual_is_what_a_random_moment_sees(law):
    """Oracle: lay sojourns end to end and look at random moments."""
    rng = np.random.default_rng(3)
    sojourns = law.sample(rng, 40_000)
    ends = np.cumsum(sojourns)
    moments = rng.integers(0, ends[-1], 20_000)
    seen = ends[np.searchsorted(ends, moments, side="right")] - moments
    drawn = np.array([residual_duration(law, rng, 10_000) for _ in range(5_000)])
    assert stats.ks_2samp(seen, drawn).pvalue > 1e-5
    expected = law.survival(np.arange(1, 4)) / law.mean()
    share = np.array([np.mean(drawn == rest) for rest in (1, 2, 3)])
    assert np.all(np.abs(share - expected) < 5 * np.sqrt(expected * (1 - expected) / drawn.size))


@systems
@pytest.mark.parametrize("slot", [0, 137])
def test_every_slot_has_the_stationary_law(fss, slot):
    """Also the first slot: chi-square over independent records."""
    rng = np.random.default_rng(11)
    records = 4_000
    found = [simulate_system(fss, slot + 1, rng).configuration[slot] for _ in range(records)]
    expected = time_law(fss) * records
    counts = np.bincount(found, minlength=fss.configurations)
    assert np.sum((counts - expected) ** 2 / expected) < stats.chi2.ppf(1 - 1e-6, fss.configurations - 1)


@systems
def test_sojourns_and_steps_follow_the_laws(fss):
    result = simulate_system(fss, 400_000, np.random.default_rng(2))
    starts = np.concatenate([[0], result.jump_index])
    q = result.configuration[starts]
    assert np.all(np.abs(np.diff(q)) == 1)
    inner = np.diff(starts)[1:]  # the first sojourn is cut, the last one is not in the differences
    for number, law in enumerate(fss.durations):
        lasted = inner[q[1:-1] == number]
        spread = np.std(law.sample(np.random.default_rng(0), 10_000)) / np.sqrt(lasted.size)
        assert abs(lasted.mean() - law.mean()) < 5 * spread
        up = np.mean(q[1:][q[:-1] == number] > number)
        expected = fss.probability_up(number)
        assert abs(up - expected) <= 5 * np.sqrt(expected * (1 - expected) / lasted.size)


def test_friction_is_drawn_once_a_sojourn_from_its_range():
    fss = SYSTEMS["three"]
    result = simulate_system(fss, 50_000, np.random.default_rng(7))
    edges = np.concatenate([[0], result.jump_index, [50_000]])
    values = []
    for start, stop in itertools.pairwise(edges):
        assert np.unique(result.friction[start:stop]).size == 1
        assert np.unique(result.configuration[start:stop]).size == 1
        values.append(result.friction[start] - result.configuration[start])
    assert stats.kstest(values, "uniform", args=(0.0, 0.5)).pvalue > 1e-5
    assert result.jump == pytest.approx(np.diff(result.friction)[result.jump_index - 1])


def test_anomaly_multiplies_the_friction_and_changes_nothing_else():
    fss = SYSTEMS["two"]
    nominal = simulate_system(fss, 5_000, np.random.default_rng(1))
    anomalous = simulate_system(fss, 5_000, np.random.default_rng(1), lambda _slot: 1.6)
    assert np.array_equal(nominal.configuration, anomalous.configuration)
    assert anomalous.friction == pytest.approx(1.6 * nominal.friction)
    growing = simulate_system(fss, 5_000, np.random.default_rng(1), lambda slot: 1.0 + slot / 5_000)
    starts = np.concatenate([[0], nominal.jump_index])
    assert growing.friction[starts] == pytest.approx(nominal.friction[starts] * (1.0 + starts / 5_000))


def test_system_without_friction_ranges_is_refused():
    with pytest.raises(InputError, match=r"fss s: friction: is missing"):
        simulate_system(system((Geometric(mean=5),) * 2, friction=False), 10, np.random.default_rng(0))
