"""Duration laws learned from few sojourns: the predictive law of the next sojourn, not the single best-fitting law.

The ends of a uniform law fitted to nine sojourns miss the true ones by a tenth of their distance, and one future
sojourn in five lies outside the range of the nine. A law that gives these no probability makes a diagnosis certain of
a wrong switching path. So the predictive law is written: the posterior mean over all laws of four families, weighted by
their probabilities (Bayesian model averaging).

The four families are uniform, geometric, log-normal and Weibull. All have a scale, whose logarithm is flat a priori,
and all but the geometric a shape with a proper prior, so that their evidences are comparable (the scale's prior is the
same in all). Configurations of one system may share a law: each partition of them into groups with one law each is
weighted by its evidence, too. So a configuration seen three times borrows strength from others as far as their
durations are similar.

Records cut sojourns (errata 9). With S(e) = P(τ ≥ e), μ the mean and N the length of a record, the likelihoods are

- begun and ended in the record, τ slots:    P(τ)
- begun, cut by the end after e slots:       S(e)
- active at the start, ended after e slots:  S(e) / μ
- active throughout:                         Σ_{r ≥ N} S(r) / μ

Leaving out the cut ones would bias the durations downwards: the longest are cut most often.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from typing import Any, Final, NamedTuple

import numpy as np
from pydantic import BaseModel
from scipy import special

from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.switching.duration_likelihoods import broad_pmf
from rwa_monitor.switching.jump_attribution import SIGMAS, Sojourn
from rwa_monitor.wheel.durations import LONGEST, Geometric, Histogram, Lognormal, Uniform, Weibull
from rwa_monitor.wheel.effects.switching_base import STRAY_SHARE
from rwa_monitor.wheel.file_content import rounded

NODES: Final = 41  # of each parameter over its posterior
REACH: Final = (-6.0, 10.0)  # standard errors over which a scale is integrated; cut sojourns only lengthen it
SHAPES: Final = (0.5, 20.0)  # of a Weibull law: from bursts to almost periodic
SCALES: Final = float(np.log(1e6))  # width of the prior of a scale's logarithm: from a slot to a day and a half at 8 Hz
BEYOND: Final = 60  # points of the integral over the tail of a sojourn that outlasts a record
POINTS: Final = 1000  # at which the survival function is computed before it is reduced to a histogram
NEGLIGIBLE: Final = 1e-7  # probability of one law of thousands, below which it is left out
FARTHEST: Final = 100.0  # times the longest sojourn seen: largest duration of a law
# P(τ ≥ e) at the edges of the histogram; between them it is linear, and the probability outside is less than the share
# of the broad law that a diagnosis mixes in.
EDGES: Final = (
    *(0.9995, 0.998, 0.99, 0.97, 0.93, 0.85, 0.75, 0.65, 0.5),
    *(0.35, 0.25, 0.15, 0.07, 0.03, 0.01, 0.002, 0.0005),
)


class LearnedLaw(NamedTuple):
    """The learned durations of a configuration.

    Attributes
    ----------
    law
        Predictive law of the next sojourn.
    family, share
        The most probable family, and its probability.
    mean, error
        Mean duration [slots] and its relative standard error.
    """

    law: Histogram
    family: str
    share: float
    mean: float
    error: float


class _Nodes(NamedTuple):
    """A family at nodes over its parameters: laws whose parameters are arrays (nodes, 1), log weights, means (nodes,).

    The weights are the prior mass of each node.
    """

    laws: Any
    log_weight: FloatArray
    mean: FloatArray


class _Group(NamedTuple):
    """Configurations that share one law: the log evidence, and the posterior over the nodes of all families."""

    log_evidence: float
    families: tuple[_Nodes, ...]
    posterior: tuple[FloatArray, ...]


def learn_laws(sojourns: Sequence[Sequence[Sojourn]]) -> list[LearnedLaw]:
    """Learn the laws of a system's configurations.

    Parameters
    ----------
    sojourns
        By configuration; at least one of each, whole or cut.

    Raises
    ------
    ValueError
        If a configuration was never seen.
    """
    if not all(sojourns):
        raise ValueError("a configuration without a sojourn has no law to learn")
    partitions = list(_partitions(tuple(range(len(sojourns)))))
    groups = {
        group: _learn([one for q in group for one in sojourns[q]]) for group in set(chain.from_iterable(partitions))
    }
    evidence = [sum(groups[group].log_evidence for group in partition) for partition in partitions]
    weights = special.softmax(evidence).tolist()
    farthest = FARTHEST * max(one.slots for seen in sojourns for one in seen)
    laws = []
    for q in range(len(sojourns)):
        of_q = [next(groups[group] for group in partition if q in group) for partition in partitions]
        laws.append(_mixture(list(zip(weights, of_q, strict=True)), farthest))
    return laws


def _partitions(items: tuple[int, ...]) -> Iterator[tuple[tuple[int, ...], ...]]:
    """Yield all partitions of items into groups."""
    if not items:
        yield ()
        return
    first, rest = items[0], items[1:]
    for smaller in _partitions(rest):
        yield ((first,), *smaller)
        for i, group in enumerate(smaller):
            yield (*smaller[:i], (first, *group), *smaller[i + 1 :])


# ---- one law for some sojourns ---------------------------------------------------------------------------------------


def _learn(sojourns: Sequence[Sojourn]) -> _Group:
    """Return the posterior of all laws given sojourns."""
    slots = np.array([one.slots for one in sojourns], dtype=np.float64)
    began, ended = np.array([(one.began, one.ended) for one in sojourns]).T
    whole = began & ended
    typical = slots[whole] if whole.any() else slots
    families = tuple(make(typical, slots) for make in FAMILIES.values())
    log_posterior = [
        nodes.log_weight
        + _log_likelihood(nodes, slots[whole], slots[began & ~ended], slots[~began & ended], slots[~began & ~ended])
        - np.log(SCALES)
        for nodes in families
    ]
    everything = float(special.logsumexp(np.concatenate(log_posterior)))
    return _Group(everything, families, tuple(np.exp(part - everything) for part in log_posterior))


def _log_likelihood(
    nodes: _Nodes, whole: FloatArray, begun: FloatArray, found: FloatArray, throughout: FloatArray
) -> FloatArray:
    """Return the log-likelihood at each node, float64 (nodes,), of sojourns, whole or censored by the records.

    `whole` from begin to end; `begun`, cut by the record's end; `found`, cut by its start; `throughout`, cut by both.
    """
    log_mean = np.log(nodes.mean)
    with np.errstate(divide="ignore"):
        total: FloatArray = np.log(
            (1.0 - STRAY_SHARE) * nodes.laws.pmf(whole) + STRAY_SHARE * broad_pmf(whole, nodes.mean[:, None])
        ).sum(axis=1)
        total += np.log(nodes.laws.survival(begun)).sum(axis=1)
        total += np.log(nodes.laws.survival(found)).sum(axis=1) - found.size * log_mean
        for length in throughout:
            at = np.geomspace(length, FARTHEST * length, BEYOND)
            total += np.log(np.trapezoid(nodes.laws.survival(at), at, axis=1)) - log_mean
    return total


def _laws_at(family: type[BaseModel], **parameters: Any) -> Any:
    """Return many laws of a family as one object whose parameters are arrays (nodes, 1), without validation.

    Its functions are elementwise: they take slots (m,) and return (nodes, m).
    """
    return family.model_construct(**{name: values[:, None] for name, values in parameters.items()})


def _geometric(typical: FloatArray, slots: FloatArray) -> _Nodes:
    count = typical.size
    z = np.linspace(*REACH, NODES)
    mean = np.maximum(slots.sum() / count * np.exp(z / np.sqrt(count)), 1.0)
    return _Nodes(_laws_at(Geometric, mean_slots=mean), np.full(NODES, np.log((z[1] - z[0]) / np.sqrt(count))), mean)


def _uniform(typical: FloatArray, slots: FloatArray) -> _Nodes:
    """Return nodes beyond the ends of the sample, spaced as the posterior of the ends falls off with distance."""
    power = max(0.5 * typical.size, 1.0)
    share = (np.arange(NODES) + 0.5) / NODES
    width = 1.0 / (NODES * share * power)  # of a node, in the logarithm of an end
    low, high = (
        values.ravel()
        for values in np.meshgrid(typical.min() * share ** (1.0 / power), slots.max() * share ** (-1.0 / power))
    )
    of_low, of_high = (values.ravel() for values in np.meshgrid(width, width))
    log_weight = np.log(of_low * low / high * of_high)  # low/high is uniform on [0, 1]
    low = np.maximum(low, 1.0)
    return _Nodes(_laws_at(Uniform, low=low, high=high), log_weight, 0.5 * (low + high))


def _lognormal(typical: FloatArray, _: FloatArray) -> _Nodes:
    sigma, z, log_weight = _shape_and_scale(SIGMAS, typical.size)
    mu = float(np.log(typical).mean()) + sigma * z
    mean = np.exp(np.minimum(mu + 0.5 * sigma**2, np.log(LONGEST)))
    return _Nodes(_laws_at(Lognormal, mu=mu, sigma=sigma), log_weight + np.log(sigma), mean)


def _weibull(typical: FloatArray, _: FloatArray) -> _Nodes:
    shape, z, log_weight = _shape_and_scale(SHAPES, typical.size)
    # The mean of log x is log λ - γ/k.
    scale = np.exp(float(np.log(typical).mean()) + (z - special.digamma(1.0)) / shape)
    laws = _laws_at(Weibull, shape=shape, scale=scale)
    return _Nodes(laws, log_weight - np.log(shape), scale * special.gamma(1.0 + 1.0 / shape))


def _shape_and_scale(shapes: tuple[float, float], count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return nodes of a shape, of the scale's logarithm in units of the law's spread, and log weights; (nodes,)."""
    at, z = np.geomspace(*shapes, NODES), np.linspace(*REACH, NODES) / np.sqrt(count)
    shape, deviation = (values.ravel() for values in np.meshgrid(at, z))
    return shape, deviation, np.full(shape.size, np.log((z[1] - z[0]) / NODES))


FAMILIES: Final[dict[str, Callable[[FloatArray, FloatArray], _Nodes]]] = {
    "uniform": _uniform,
    "geometric": _geometric,
    "lognormal": _lognormal,
    "weibull": _weibull,
}


# ---- the predictive law ----------------------------------------------------------------------------------------------


def _mixture(parts: Sequence[tuple[float, _Group]], farthest: float) -> LearnedLaw:
    """Return the predictive law: the mixture of groups by their weights."""
    at: IntArray = np.unique(np.geomspace(1.0, min(max(farthest, 100.0), LONGEST), POINTS).astype(np.int64))
    survival, shares = np.zeros(at.size), np.zeros(len(FAMILIES))
    log_mean, square = 0.0, 0.0
    for weight, group in parts:
        for f, (nodes, posterior) in enumerate(zip(group.families, group.posterior, strict=True)):
            likely = posterior * weight > NEGLIGIBLE
            if not likely.any():
                continue
            parameters = {name: values[likely, 0] for name, values in nodes.laws if name != "law"}
            survival += weight * (posterior[likely] @ _laws_at(type(nodes.laws), **parameters).survival(at))
            shares[f] += weight * float(posterior.sum())
            log_means = np.log(nodes.mean[likely])
            log_mean += weight * float(posterior[likely] @ log_means)
            square += weight * float(posterior[likely] @ log_means**2)
    best = int(np.argmax(shares))
    law = _histogram(at, survival / survival[0])
    error = float(np.sqrt(max(square - log_mean**2, 0.0)))
    return LearnedLaw(law, list(FAMILIES)[best], float(shares[best]), law.mean(), error)


def _histogram(at: IntArray, survival: FloatArray) -> Histogram:
    """Return the histogram whose edges are the durations at which the survival function passes `EDGES`."""
    edges: IntArray = np.unique([int(at[np.flatnonzero(survival >= level)[-1]]) for level in EDGES])
    if edges.size == 1:
        edges = np.append(edges, edges[0] + 1)
    beyond = np.interp(edges, at, survival)
    beyond[-1] = 0.0
    return Histogram(
        edges=tuple(edges.tolist()),
        weights=tuple(rounded(share, 4) for share in -np.diff(beyond)),
    )
