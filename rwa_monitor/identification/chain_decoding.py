"""Which switching system each jump of a record is of: the likeliest paths of several semi-Markov chains at once.

A record is a sequence of stays at constant friction. Each stay's level is the base plus what each system adds, and from
one stay to the next a system steps to an adjacent configuration. A configuration's friction is drawn anew whenever it
is entered and then stays, so a way down closes exactly with the way up, whatever happens in between: given the path,
levels are linear in base and frictions, and a Kalman filter gives their likelihood. Paths are followed by a beam
search: multiple-hypothesis tracking (Reid, IEEE Transactions on Automatic Control 24 (1979) 843) of jump Markov linear
systems (Ghahramani, Hinton, Neural Computation 12 (2000) 831).

Durations are log-normal here, with a broad tail. That is only to part the jumps; laws are learned from what comes out.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from math import erfc, exp, inf, log, pi, sqrt
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from rwa_monitor.samples import BoolArray, FloatArray, IntArray

LARGEST_MOVE: Final = 2  # systems that step in the same slot, or between two stays of which the one between is not seen
# Per slot, of a jump that is no system's: a hundredth of the rate of the rarest jumps that a recording of hours shows.
FALSE_RATE: Final = 1e-7
OUTLIER_SHARE: Final = 3e-3  # of the stays: too short for their level, or with jumps in them that are not seen
BROAD_SHARE: Final = 0.03  # of the sojourns, as far from the others as a decade
BROAD_SIGMA: Final = 2.3
NEVER: Final = 1e-300  # a probability whose logarithm is finite


@dataclass(frozen=True, slots=True)
class Stays:
    """A record as stays at constant friction.

    Attributes
    ----------
    level, std
        float64 (k,), s·torque less viscous friction, and its standard deviation [N m].
    at
        int64 (k + 1,), the slot in which each begins, and that after the last.
    """

    level: FloatArray
    std: FloatArray
    at: IntArray


@dataclass(frozen=True, slots=True)
class Chains:
    """Switching systems as they are known while jumps are parted; arrays (systems, configurations), padded.

    Attributes
    ----------
    counts
        Configurations of each system.
    size, spread
        Mean and standard deviation of the friction above that of the lowest configuration [N m]; 0 in it.
    mu, sigma
        Of the logarithm of a sojourn's slots.
    up
        Probability of the step up.
    base, base_std
        Friction with all at rest, and what records differ by in it [N m].
    """

    counts: tuple[int, ...]
    size: FloatArray
    spread: FloatArray
    mu: FloatArray
    sigma: FloatArray
    up: FloatArray
    base: float
    base_std: float


@dataclass(frozen=True, slots=True)
class Path:
    """The likeliest path of a record.

    Attributes
    ----------
    configurations
        int64 (k, systems).
    outlier
        bool (k,), stays whose level no system explains.
    log_likelihood
        Of levels and times together.
    """

    configurations: IntArray
    outlier: BoolArray
    log_likelihood: float


def decode(stays: Stays, chains: Chains, beam: int) -> Path:
    """Return the likeliest path of a record.

    Parameters
    ----------
    stays
        The record, at least one stay.
    chains
        The systems.
    beam
        Paths followed.
    """
    counts = chains.counts
    configurations = np.array(list(product(*(range(count) for count in counts))), dtype=np.int64)
    moves = np.array(
        [move for move in product((0, 1, -1), repeat=len(counts)) if np.count_nonzero(move) <= LARGEST_MOVE],
        dtype=np.int64,
    )
    laws = _Laws(
        np.array(counts, dtype=np.int64),
        chains.size,
        chains.spread**2,
        chains.mu,
        chains.sigma,
        np.log(np.clip(chains.up, NEVER, 1.0)),
        np.log(np.clip(1.0 - chains.up, NEVER, 1.0)),
        chains.base,
        chains.base_std**2,
    )
    record = _Record(stays.level, stays.std**2, stays.at)
    states = _States(configurations, _log_stationary(configurations, chains))
    found, outlier, value = _decode(record, laws, states, moves, beam)
    return Path(found, outlier, float(value))


class _Record(NamedTuple):
    """`Stays` as compiled code takes them: level [N m], its variance [N² m²], slots; see there."""

    level: FloatArray
    variance: FloatArray
    at: IntArray


class _Laws(NamedTuple):
    """`Chains` as compiled code takes them: counts (systems,), then arrays (systems, configurations); see there."""

    counts: IntArray
    size: FloatArray
    variance: FloatArray  # of the size [N² m²]
    mu: FloatArray
    sigma: FloatArray
    log_up: FloatArray
    log_down: FloatArray
    base: float
    base_variance: float


class _States(NamedTuple):
    """All joint states: int64 (states, systems), and the log probability of each at a random moment, (states,)."""

    configuration: IntArray
    log_probability: FloatArray


class _Tracks(NamedTuple):
    """The paths that are followed.

    Attributes
    ----------
    configuration, since, began
        (paths, systems): where each system is, the slot since which, and whether that is in the record.
    mean, covariance
        float64 (paths, 1 + systems) and (paths, 1 + systems, 1 + systems): the Kalman state, base first, then what
        each system adds [N m].
    score
        float64 (paths,), log-likelihood of what has happened.
    """

    configuration: IntArray
    since: IntArray
    began: BoolArray
    mean: FloatArray
    covariance: FloatArray
    score: FloatArray


def _log_stationary(states: IntArray, chains: Chains) -> FloatArray:
    """Return the log probability of each joint state at a random moment, (states,)."""
    total = np.zeros(states.shape[0])
    for system, count in enumerate(chains.counts):
        visits = np.ones(count)
        for q in range(1, count):  # what goes up from q - 1 comes down from q
            visits[q] = visits[q - 1] * chains.up[system, q - 1] / max(1.0 - chains.up[system, q], 1e-3)
        share = visits * np.exp(chains.mu[system, :count] + 0.5 * chains.sigma[system, :count] ** 2)
        total += np.log(share / share.sum())[states[:, system]]
    return total


@njit(cache=True, nogil=True)
def _log_density(slots: float, mu: float, sigma: float) -> float:
    """Return the log probability that a sojourn lasts so many slots."""
    x = log(slots) - mu
    near = exp(-0.5 * (x / sigma) ** 2) / sigma
    far = exp(-0.5 * (x / BROAD_SIGMA) ** 2) / BROAD_SIGMA
    return log(((1.0 - BROAD_SHARE) * near + BROAD_SHARE * far) / sqrt(2.0 * pi) + NEVER) - log(slots)


@njit(cache=True, nogil=True)
def _log_survival(slots: float, mu: float, sigma: float) -> float:
    """Return the log probability that a sojourn lasts at least so long."""
    x = (log(slots) - mu) / sqrt(2.0)
    near, far = 0.5 * erfc(x / sigma), 0.5 * erfc(x / BROAD_SIGMA)
    return log((1.0 - BROAD_SHARE) * near + BROAD_SHARE * far + NEVER)


@njit(cache=True, nogil=True)
def _log_gauss(deviation: float, variance: float) -> float:
    return -0.5 * (deviation * deviation / variance + log(2.0 * pi * variance))


@njit(cache=True, nogil=True)
def _decode(
    record: _Record, laws: _Laws, states: _States, moves: IntArray, beam: int
) -> tuple[IntArray, BoolArray, float]:
    """Follow the paths.

    A path's score is the log-likelihood of what has happened; it is ranked with that of what has not happened yet, the
    survival of the sojourns under way.
    """
    level, variance, at = record
    n, systems = level.size, laws.counts.size
    room = max(beam, 2 * states.configuration.shape[0])
    doubt = log(OUTLIER_SHARE) - log(level.max() - level.min() + sqrt(laws.base_variance) + sqrt(variance.max()))
    tracks = _empty(room, systems)
    parents = np.zeros((n, room), np.int64)
    history = np.zeros((n, room, systems), np.int64)
    odd = np.zeros((n, room), np.bool_)
    paths = _begin(tracks, record, laws, states, doubt)
    for b in range(paths):
        history[0, b], odd[0, b] = tracks.configuration[b], b % 2 == 1
    options = moves.shape[0]
    for j in range(1, n):
        value, rank = _ways_on(tracks, paths, j, record, laws, moves, doubt)
        best = np.argsort(-rank)[:beam]
        following = _empty(room, systems)
        paths = 0
        for chosen in best:
            if value[chosen] == -inf:
                break
            b, m, outlier = chosen // (2 * options), (chosen // 2) % options, chosen % 2
            _go_on(tracks, b, following, paths, moves[m], at[j], laws)
            if outlier == 0:
                _observe(following, paths, level[j], variance[j])
            following.score[paths] = value[chosen]
            parents[j, paths], history[j, paths], odd[j, paths] = b, following.configuration[paths], outlier == 1
            paths += 1
        tracks = following
    score = tracks.score
    for b in range(paths):
        for i in range(systems):
            q = tracks.configuration[b, i]
            score[b] += _log_survival(at[n] - tracks.since[b, i], laws.mu[i, q], laws.sigma[i, q])
    last = int(np.argmax(score[:paths]))
    total = score[last]
    found, outliers = np.zeros((n, systems), np.int64), np.zeros(n, np.bool_)
    for j in range(n - 1, -1, -1):
        found[j], outliers[j] = history[j, last], odd[j, last]
        last = parents[j, last]
    return found, outliers, total


@njit(cache=True, nogil=True)
def _empty(room: int, systems: int) -> _Tracks:
    """Return room for paths."""
    return _Tracks(
        np.zeros((room, systems), np.int64),
        np.zeros((room, systems), np.int64),
        np.zeros((room, systems), np.bool_),
        np.zeros((room, systems + 1)),
        np.zeros((room, systems + 1, systems + 1)),
        np.full(room, -inf),
    )


@njit(cache=True, nogil=True)
def _begin(tracks: _Tracks, record: _Record, laws: _Laws, states: _States, doubt: float) -> int:
    """Begin a path in each joint state, with the first stay as it is and as an outlier; return how many."""
    joint = states.configuration
    mean, covariance = tracks.mean, tracks.covariance
    for s in range(joint.shape[0]):
        for b in (2 * s, 2 * s + 1):
            tracks.configuration[b], tracks.since[b] = joint[s], record.at[0]
            mean[b, 0], covariance[b, 0, 0] = laws.base, laws.base_variance
            for i in range(joint.shape[1]):
                mean[b, i + 1] = laws.size[i, joint[s, i]]
                covariance[b, i + 1, i + 1] = laws.variance[i, joint[s, i]]
        off, variance = record.level[0] - mean[2 * s].sum(), covariance[2 * s].sum() + record.variance[0]
        plain = states.log_probability[s] + log(1.0 - OUTLIER_SHARE) + _log_gauss(off, variance)
        tracks.score[2 * s], tracks.score[2 * s + 1] = plain, states.log_probability[s] + doubt
        _observe(tracks, 2 * s, record.level[0], record.variance[0])
    return int(2 * joint.shape[0])


@njit(cache=True, nogil=True)
def _observe(tracks: _Tracks, b: int, level: float, level_variance: float) -> None:
    """Update a path's Kalman state by a stay's level, the sum of all its entries."""
    mean, covariance = tracks.mean, tracks.covariance
    variance = covariance[b].sum() + level_variance
    gain = covariance[b].sum(axis=1) / variance
    mean[b] += gain * (level - mean[b].sum())
    covariance[b] -= np.outer(gain, gain) * variance


@njit(cache=True, nogil=True)
def _go_on(tracks: _Tracks, b: int, following: _Tracks, p: int, move: IntArray, slot: int, laws: _Laws) -> None:
    """Copy path b to place p of those that follow, with its systems moved."""
    following.configuration[p], following.since[p] = tracks.configuration[b], tracks.since[b]
    following.began[p], following.mean[p] = tracks.began[b], tracks.mean[b]
    following.covariance[p] = tracks.covariance[b]
    for i in range(move.size):
        if move[i] != 0:
            q = following.configuration[p, i] + move[i]
            following.configuration[p, i], following.since[p, i], following.began[p, i] = q, slot, True
            following.mean[p, i + 1] = laws.size[i, q]
            following.covariance[p, i + 1, :] = 0.0
            following.covariance[p, :, i + 1] = 0.0
            following.covariance[p, i + 1, i + 1] = laws.variance[i, q]


@njit(cache=True, nogil=True)
def _ways_on(
    tracks: _Tracks, paths: int, j: int, record: _Record, laws: _Laws, moves: IntArray, doubt: float
) -> tuple[FloatArray, FloatArray]:
    """Return score and rank of each path with each move into stay j, as it is and as an outlier; -inf if impossible."""
    level, variance, at = record
    options = moves.shape[0]
    value, rank = np.full(paths * options * 2, -inf), np.full(paths * options * 2, -inf)
    entering = _log_entering(at[j + 1] - at[j], laws)
    for b in range(paths):
        gone, staying = _log_of_sojourns(tracks, b, at[j], at[j + 1], laws)
        for m in range(options):
            worth, ahead = _log_of_move(tracks.configuration[b], moves[m], gone, staying, entering, laws)
            if worth == -inf:
                continue
            expected, spread = _expected(tracks, b, moves[m], laws)
            at_once = (b * options + m) * 2
            plain = _log_gauss(level[j] - expected, spread + variance[j]) + log(1.0 - OUTLIER_SHARE)
            value[at_once] = tracks.score[b] + worth + plain
            value[at_once + 1] = tracks.score[b] + worth + doubt
            rank[at_once] = value[at_once] + ahead
            rank[at_once + 1] = value[at_once + 1] + ahead
    return value, rank


@njit(cache=True, nogil=True)
def _log_entering(slots: int, laws: _Laws) -> FloatArray:
    """Return the log-survival of a sojourn of so many slots in each configuration."""
    entering = np.zeros(laws.mu.shape)
    for i in range(laws.counts.size):
        for q in range(laws.counts[i]):
            entering[i, q] = _log_survival(slots, laws.mu[i, q], laws.sigma[i, q])
    return entering


@njit(cache=True, nogil=True)
def _log_of_sojourns(tracks: _Tracks, b: int, slot: int, later: int, laws: _Laws) -> tuple[FloatArray, FloatArray]:
    """Return, for each system of a path, the log-likelihood of leaving at a slot, and of staying until a later one."""
    systems = tracks.since.shape[1]
    gone, staying = np.zeros(systems), np.zeros(systems)
    for i in range(systems):
        q, since = tracks.configuration[b, i], tracks.since[b, i]
        m, s, lasted = laws.mu[i, q], laws.sigma[i, q], slot - since
        # What was there when the record began is seen from a random moment on: S(e)/mean.
        gone[i] = _log_density(lasted, m, s) if tracks.began[b, i] else _log_survival(lasted, m, s) - m - 0.5 * s * s
        staying[i] = _log_survival(later - since, m, s)
    return gone, staying


@njit(cache=True, nogil=True)
def _log_of_move(
    configuration: IntArray, move: IntArray, gone: FloatArray, staying: FloatArray, entering: FloatArray, laws: _Laws
) -> tuple[float, float]:
    """Return the log-likelihood of a move, and of what has not happened after it; -inf if there is no such way."""
    worth, ahead, steps = 0.0, 0.0, 0
    for i in range(configuration.size):
        q = configuration[i] + move[i]
        if move[i] == 0:
            ahead += staying[i]
        elif q < 0 or q >= laws.counts[i]:
            return -inf, 0.0
        else:
            steps += 1
            worth += gone[i] + (laws.log_up[i, configuration[i]] if move[i] > 0 else laws.log_down[i, configuration[i]])
            ahead += entering[i, q]
    return (worth if steps else log(FALSE_RATE)), ahead


@njit(cache=True, nogil=True)
def _expected(tracks: _Tracks, b: int, move: IntArray, laws: _Laws) -> tuple[float, float]:
    """Return mean and variance of the level after a move."""
    expected, variance = 0.0, 0.0
    for i in range(-1, move.size):
        if i >= 0 and move[i] != 0:
            q = tracks.configuration[b, i] + move[i]
            expected += laws.size[i, q]
            variance += laws.variance[i, q]
            continue
        expected += tracks.mean[b, i + 1]
        for k in range(-1, move.size):
            if k < 0 or move[k] == 0:
                variance += tracks.covariance[b, i + 1, k + 1]
    return expected, variance
