"""Switching systems and their laws of duration against what their definitions give, by brute force."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy import stats

from rwa_monitor.errors import InputError
from rwa_monitor.wheel.durations import Geometric, Histogram, Lognormal, Uniform, Weibull
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
    growing = simulate_system(fss, 5_000, np.random.default_rng(1), lambda slot: 1.0 + slot / 5_000)
    assert np.array_equal(nominal.configuration, growing.configuration)
    starts = np.concatenate([[0], nominal.jump_index])
    assert growing.friction[starts] == pytest.approx(nominal.friction[starts] * (1.0 + starts / 5_000))


def test_system_without_friction_ranges_is_refused():
    with pytest.raises(InputError, match=r"fss s: friction: is missing"):
        simulate_system(system((Geometric(mean=5),) * 2, friction=False), 10, np.random.default_rng(0))


# ---- laws of duration ------------------------------------------------------------------------------------------------


LAWS = {
    "uniform": Uniform(low=3, high=17),
    "uniform of one": Uniform(low=5, high=5),
    "geometric": Geometric(mean=9.5),
    "geometric of one": Geometric(mean=1.0),
    "weibull": Weibull(shape=1.7, scale=20.0),
    "weibull heavy": Weibull(shape=0.7, scale=5.0),
    "weibull below one slot": Weibull(shape=2.0, scale=0.6),
    "lognormal": Lognormal(mu=2.0, sigma=0.6),
    "lognormal below one slot": Lognormal(mu=-1.0, sigma=0.5),
    "histogram": Histogram(edges=(2, 5, 9, 20), weights=(1.0, 0.0, 3.0)),
}
laws = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())


def brute_pmf(law, upto):
    """P(τ = k) for k = 1 … upto, straight from each law's definition."""
    k = np.arange(1, upto + 1)
    if isinstance(law, Uniform):
        return np.where((k >= law.low) & (k <= law.high), 1.0 / (law.high - law.low + 1), 0.0)
    if isinstance(law, Geometric):
        return stats.geom.pmf(k, 1.0 / law.mean_slots)
    if isinstance(law, Histogram):
        pmf = np.zeros(upto)
        for low, high, weight in zip(law.edges, law.edges[1:], law.weights, strict=False):
            pmf[low - 1 : high - 1] = weight / sum(law.weights) / (high - low)
        return pmf
    if isinstance(law, Weibull):
        continuous = stats.weibull_min(law.shape, scale=law.scale)
    else:
        continuous = stats.lognorm(law.sigma, scale=np.exp(law.mu))
    pmf = continuous.cdf(k + 0.5) - continuous.cdf(k - 0.5)
    pmf[0] = continuous.cdf(1.5)  # everything below one slot is put on one
    return pmf


@laws
def test_pmf_survival_and_mean_follow_the_definition(law):
    upto = int(law.longest()) + 2
    at, pmf = np.arange(1, upto + 1), brute_pmf(law, upto)
    survivals = np.cumsum(pmf[::-1])[::-1]
    assert law.pmf(at) == pytest.approx(pmf, abs=1e-12)
    assert law.pmf(at).sum() == pytest.approx(1.0, abs=1e-10)
    assert np.all(law.pmf([0, -1, -100]) == 0.0)
    assert law.survival(at) == pytest.approx(survivals, abs=1e-10)
    assert np.all(law.survival([1, 0, -5]) == 1.0)
    assert law.survival(law.longest() + 1) <= 1e-11
    assert law.mean() == pytest.approx(np.sum(pmf * at), rel=1e-8)
    for start in (1, 2, 7, upto - 1, upto + 10):
        assert law.survival_sum(start) == pytest.approx(survivals[start - 1 :].sum(), abs=1e-8)


@laws
def test_samples_follow_the_pmf(law):
    size = 20_000
    drawn = law.sample(np.random.default_rng(5), size)
    assert drawn.dtype == np.int64
    assert drawn.min() >= 1
    pmf = brute_pmf(law, int(law.longest()) + 2)
    observed = np.bincount(np.minimum(drawn, pmf.size), minlength=pmf.size + 1)[1:]
    # Bins of at least 20 expected draws; what is left forms the last bin.
    frequent = pmf * size >= 20
    expected = np.append(pmf[frequent], max(0.0, 1.0 - pmf[frequent].sum())) * size
    counts = np.append(observed[frequent], observed[~frequent].sum())
    if expected[-1] < 1.0:
        assert counts[-1] <= 10
        expected, counts = expected[:-1], counts[:-1]
    statistic = np.sum((counts - expected) ** 2 / expected)
    assert statistic < stats.chi2.ppf(1 - 1e-6, max(1, counts.size - 1))


@pytest.mark.parametrize(
    ("law", "mean"),
    [
        (Uniform(low=1, high=4_000_000), 2_000_000.5),
        (Weibull(shape=1.0, scale=1e6), 1e6),
        (Lognormal(mu=float(np.log(1e6)), sigma=0.5), 1e6 * np.exp(0.125)),
        (Lognormal(mu=float(np.log(1e4)), sigma=2.0), 1e4 * np.exp(2.0)),
        (Weibull(shape=0.5, scale=1e6), 2e6),
    ],
)
def test_mean_of_very_long_laws(law, mean):
    assert law.mean() == pytest.approx(mean, rel=1e-4)


@given(
    weights=st.lists(st.floats(0, 10), min_size=1, max_size=8).filter(lambda w: sum(w) > 1e-3),
    steps=st.lists(st.integers(1, 30), min_size=9, max_size=9),
)
def test_every_histogram_is_a_law(weights, steps):
    edges = tuple(int(edge) for edge in np.cumsum(steps)[: len(weights) + 1])
    law = Histogram(edges=edges, weights=tuple(weights))
    at = np.arange(1, edges[-1] + 3)
    assert law.pmf(at).sum() == pytest.approx(1.0)
    assert np.all(np.diff(law.survival(at)) <= 1e-12)
    drawn = law.sample(np.random.default_rng(0), 100)
    assert np.all(law.pmf(drawn) > 0)


@pytest.mark.parametrize(
    ("law", "values"),
    [
        (Uniform, {"low": 5, "high": 4}),
        (Uniform, {"low": 1, "high": 10**30}),
        (Geometric, {"mean": 0.5}),
        (Weibull, {"shape": 0.0, "scale": 1.0}),
        (Weibull, {"shape": 1.0, "scale": 1e300}),
        (Lognormal, {"mu": 1e4, "sigma": 1.0}),
        (Histogram, {"edges": (1, 2), "weights": (0.0,)}),
        (Histogram, {"edges": (2, 2), "weights": (1.0,)}),
        (Histogram, {"edges": (1, 2), "weights": (-1.0,)}),
    ],
)
def test_impossible_laws_are_refused(law, values):
    with pytest.raises(ValidationError):
        law(**values)
