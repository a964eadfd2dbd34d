"""Duration laws against what their definitions give, by brute force."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy import stats

from rwa_monitor.wheel.durations import Geometric, Histogram, Lognormal, Uniform, Weibull

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
