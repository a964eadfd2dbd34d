"""Which switching system each jump of a record is of: the likeliest paths of several semi-Markov chains at once.

A record is a sequence of segments at constant friction. Each segment's level is the base plus what each system adds,
and from one segment to the next a system steps to an adjacent configuration. A configuration's friction is drawn anew
whenever it is entered and then stays, so a way down closes exactly with the way up, whatever happens in between:
given the path, levels are linear in base and frictions, and a Kalman filter gives their likelihood. Paths are followed
by a beam search: multiple-hypothesis tracking (Reid, IEEE Transactions on Automatic Control 24 (1979) 843) of jump
Markov linear systems (Ghahramani, Hinton, Neural Computation 12 (2000) 831).

Durations are log-normal here, with a broad tail. That is only to attribute the jumps; laws are learned from what comes
out.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.kernels.chain_decoding import NEVER, likeliest_path
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

# Systems that step in the same slot, or between two segments of which the one between is not seen.
LARGEST_MOVE: Final = 2


@dataclass(frozen=True, slots=True)
class Segments:
    """A record as segments at constant friction.

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
    """Switching systems as they are known while jumps are attributed; arrays (systems, configurations), padded.

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
        bool (k,), segments whose level no system explains.
    log_likelihood
        Of levels and times together.
    """

    configurations: IntArray
    outlier: BoolArray
    log_likelihood: float


def decode(segments: Segments, chains: Chains, beam: int) -> Path:
    """Return the likeliest path of a record.

    Parameters
    ----------
    segments
        The record, at least one segment.
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
    laws = Laws(
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
    record = Record(segments.level, segments.std**2, segments.at)
    states = States(configurations, _log_stationary(configurations, chains))
    found, outlier, value = likeliest_path(record, laws, states, moves, beam)
    return Path(found, outlier.view(np.bool_), value)


class Record(NamedTuple):
    """`Segments` as compiled code takes them: level [N m], its variance [N² m²], slots; see there."""

    level: FloatArray
    variance: FloatArray
    at: IntArray


class Laws(NamedTuple):
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


class States(NamedTuple):
    """All joint states: int64 (states, systems), and the log probability of each at a random moment, (states,)."""

    configuration: IntArray
    log_probability: FloatArray


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
