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
from typing import Final

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
    states = np.array(list(product(*(range(count) for count in counts))), dtype=np.int64)
    moves = np.array(
        [move for move in product((0, 1, -1), repeat=len(counts)) if np.count_nonzero(move) <= LARGEST_MOVE],
        dtype=np.int64,
    )
    laws = (
        np.array(counts, dtype=np.int64),
        *(chains.size, chains.spread**2, chains.mu, chains.sigma),
        np.log(np.clip(chains.up, NEVER, 1.0)),
        np.log(np.clip(1.0 - chains.up, NEVER, 1.0)),
    )
    known = chains.base, chains.base_std**2
    record = stays.level, stays.std**2, stays.at
    configurations, outlier, value = _decode(
        record, laws, known, (states, _log_stationary(states, chains)), moves, beam
    )
    return Path(configurations, outlier, float(value))


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
def _decode(record, laws, base, states, moves, beam):  # type: ignore[no-untyped-def]
    """Follow the paths.

    A path's score is the log-likelihood of what has happened; it is ranked with that of what has not happened yet, the
    survival of the sojourns under way.
    """
    level, var, at = record
    n, systems = level.size, laws[0].size
    room = max(beam, 2 * states[0].shape[0])
    doubt = log(OUTLIER_SHARE) - log(level.max() - level.min() + sqrt(base[1]) + sqrt(var.max()))
    tracks = _empty(room, systems)
    parents = np.zeros((n, room), np.int64)
    history = np.zeros((n, room, systems), np.int64)
    odd = np.zeros((n, room), np.bool_)
    paths = _begin(tracks, record, laws, base, states, doubt)
    for b in range(paths):
        history[0, b], odd[0, b] = tracks[0][b], b % 2 == 1
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
                _observe(following, paths, level[j], var[j])
            following[5][paths] = value[chosen]
            parents[j, paths], history[j, paths], odd[j, paths] = b, following[0][paths], outlier == 1
            paths += 1
        tracks = following
    conf, since, score = tracks[0], tracks[1], tracks[5]
    for b in range(paths):
        for i in range(systems):
            score[b] += _log_survival(at[n] - since[b, i], laws[3][i, conf[b, i]], laws[4][i, conf[b, i]])
    last = int(np.argmax(score[:paths]))
    total = score[last]
    found, outliers = np.zeros((n, systems), np.int64), np.zeros(n, np.bool_)
    for j in range(n - 1, -1, -1):
        found[j], outliers[j] = history[j, last], odd[j, last]
        last = parents[j, last]
    return found, outliers, total


@njit(cache=True, nogil=True)
def _empty(room, systems):  # type: ignore[no-untyped-def]
    """Return room for paths: configurations, begins of their sojourns, whether in the record; Kalman state; scores."""
    return (
        np.zeros((room, systems), np.int64),
        np.zeros((room, systems), np.int64),
        np.zeros((room, systems), np.bool_),
        np.zeros((room, systems + 1)),
        np.zeros((room, systems + 1, systems + 1)),
        np.full(room, -inf),
    )


@njit(cache=True, nogil=True)
def _begin(tracks, record, laws, base, states, doubt):  # type: ignore[no-untyped-def]
    """Begin a path in each joint state, with the first stay as it is and as an outlier; return how many."""
    conf, since, _, mean, cov, score = tracks
    level, var, at = record
    joint, log_state = states
    for s in range(joint.shape[0]):
        for b in (2 * s, 2 * s + 1):
            conf[b], since[b] = joint[s], at[0]
            mean[b, 0], cov[b, 0, 0] = base
            for i in range(joint.shape[1]):
                mean[b, i + 1] = laws[1][i, joint[s, i]]
                cov[b, i + 1, i + 1] = laws[2][i, joint[s, i]]
        off = level[0] - mean[2 * s].sum()
        score[2 * s] = log_state[s] + log(1.0 - OUTLIER_SHARE) + _log_gauss(off, cov[2 * s].sum() + var[0])
        _observe(tracks, 2 * s, level[0], var[0])
        score[2 * s + 1] = log_state[s] + doubt
    return 2 * joint.shape[0]


@njit(cache=True, nogil=True)
def _observe(tracks, b, level, var):  # type: ignore[no-untyped-def]
    """Update a path's Kalman state by a stay's level, the sum of all its entries."""
    mean, cov = tracks[3], tracks[4]
    variance = cov[b].sum() + var
    gain = cov[b].sum(axis=1) / variance
    mean[b] += gain * (level - mean[b].sum())
    cov[b] -= np.outer(gain, gain) * variance


@njit(cache=True, nogil=True)
def _go_on(tracks, b, following, p, move, slot, laws):  # type: ignore[no-untyped-def]
    """Copy path b to place p of those that follow, with its systems moved."""
    conf, since, began, mean, cov, _ = following
    conf[p], since[p], began[p] = tracks[0][b], tracks[1][b], tracks[2][b]
    mean[p], cov[p] = tracks[3][b], tracks[4][b]
    for i in range(move.size):
        if move[i] != 0:
            q = conf[p, i] + move[i]
            conf[p, i], since[p, i], began[p, i] = q, slot, True
            mean[p, i + 1] = laws[1][i, q]
            cov[p, i + 1, :] = 0.0
            cov[p, :, i + 1] = 0.0
            cov[p, i + 1, i + 1] = laws[2][i, q]


@njit(cache=True, nogil=True)
def _ways_on(tracks, paths, j, record, laws, moves, doubt):  # type: ignore[no-untyped-def]
    """Return score and rank of each path with each move into stay j, as it is and as an outlier; -inf if impossible."""
    level, var, at = record
    options = moves.shape[0]
    value, rank = np.full(paths * options * 2, -inf), np.full(paths * options * 2, -inf)
    entering = _log_entering(at[j + 1] - at[j], laws)
    for b in range(paths):
        gone, staying = _log_of_sojourns(tracks, b, at[j], at[j + 1], laws)
        for m in range(options):
            worth, ahead = _log_of_move(tracks[0][b], moves[m], gone, staying, entering, laws)
            if worth == -inf:
                continue
            expected, variance = _expected(tracks, b, moves[m], laws)
            at_once = (b * options + m) * 2
            plain = _log_gauss(level[j] - expected, variance + var[j]) + log(1.0 - OUTLIER_SHARE)
            value[at_once] = tracks[5][b] + worth + plain
            value[at_once + 1] = tracks[5][b] + worth + doubt
            rank[at_once] = value[at_once] + ahead
            rank[at_once + 1] = value[at_once + 1] + ahead
    return value, rank


@njit(cache=True, nogil=True)
def _log_entering(slots, laws):  # type: ignore[no-untyped-def]
    """Return the log-survival of a sojourn of so many slots in each configuration."""
    counts, mu, sigma = laws[0], laws[3], laws[4]
    entering = np.zeros(mu.shape)
    for i in range(counts.size):
        for q in range(counts[i]):
            entering[i, q] = _log_survival(slots, mu[i, q], sigma[i, q])
    return entering


@njit(cache=True, nogil=True)
def _log_of_sojourns(tracks, b, now, later, laws):  # type: ignore[no-untyped-def]
    """Return, for each system of a path, the log-likelihood of leaving now, and of staying until later."""
    conf, since, began = tracks[0], tracks[1], tracks[2]
    mu, sigma = laws[3], laws[4]
    gone, staying = np.zeros(conf.shape[1]), np.zeros(conf.shape[1])
    for i in range(conf.shape[1]):
        m, s, lasted = mu[i, conf[b, i]], sigma[i, conf[b, i]], now - since[b, i]
        # What was there when the record began is seen from a random moment on: S(e)/mean.
        gone[i] = _log_density(lasted, m, s) if began[b, i] else _log_survival(lasted, m, s) - m - 0.5 * s * s
        staying[i] = _log_survival(later - since[b, i], m, s)
    return gone, staying


@njit(cache=True, nogil=True)
def _log_of_move(conf, move, gone, staying, entering, laws):  # type: ignore[no-untyped-def]
    """Return the log-likelihood of a move, and of what has not happened after it; -inf if there is no such way."""
    counts, log_up, log_down = laws[0], laws[5], laws[6]
    worth, ahead, steps = 0.0, 0.0, 0
    for i in range(conf.size):
        q = conf[i] + move[i]
        if move[i] == 0:
            ahead += staying[i]
        elif q < 0 or q >= counts[i]:
            return -inf, 0.0
        else:
            steps += 1
            worth += gone[i] + (log_up[i, conf[i]] if move[i] > 0 else log_down[i, conf[i]])
            ahead += entering[i, q]
    return (worth if steps else log(FALSE_RATE)), ahead


@njit(cache=True, nogil=True)
def _expected(tracks, b, move, laws):  # type: ignore[no-untyped-def]
    """Return mean and variance of the level after a move."""
    conf, mean, cov = tracks[0], tracks[3], tracks[4]
    expected, variance = 0.0, 0.0
    for i in range(-1, move.size):
        if i >= 0 and move[i] != 0:
            expected += laws[1][i, conf[b, i] + move[i]]
            variance += laws[2][i, conf[b, i] + move[i]]
            continue
        expected += mean[b, i + 1]
        for k in range(-1, move.size):
            if k < 0 or move[k] == 0:
                variance += cov[b, i + 1, k + 1]
    return expected, variance
