"""Jumps of recordings attributed to switching systems, without knowing how many there are.

Two systems are distinguished by the sizes of their jumps, by the durations of their sojourns, and by the structure of a
system: it steps between adjacent configurations, and its way down removes what its way up added. All three are in the
likelihood of a switching path. For each number of systems and of their configurations, decoding and estimation of sizes
and durations alternate until they agree (segmental k-means: Rabiner, Wilpon, Juang, AT&T Technical Journal 65 (1986)
21), from several starts; the description with the best Bayesian information criterion is chosen (Schwarz, Annals of
Statistics 6 (1978) 461).

A record is a sequence of segments at constant friction. Each segment's level is the base plus what each system adds,
and from one segment to the next a system steps to an adjacent configuration. A configuration's friction is drawn anew
whenever it is entered and then stays, so the way down cancels the way up exactly, whatever happens in between:
given the path, levels are linear in base and frictions, and a Kalman filter gives their likelihood. Paths are followed
by a beam search: multiple-hypothesis tracking (Reid, IEEE Transactions on Automatic Control 24 (1979) 843) of jump
Markov linear systems (Ghahramani, Hinton, Neural Computation 12 (2000) 831).

Durations are log-normal here, mixed with a broad outlier law. That serves only to attribute the jumps; the duration
laws of a wheel file are learned from the result.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise, product
from typing import Final, NamedTuple

import numpy as np
from scipy import special

from rwa_monitor.kernels.chain_decoding import NEVER, likeliest_path
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

# Numbers of configurations of the systems, simple ones first: the next tier is tried while the criterion improves.
TIERS: Final = (
    ((2,), (3,), (2, 2)),
    ((4,), (2, 3), (2, 2, 2)),
    ((5,), (2, 4), (3, 3), (2, 2, 3)),
)
# Systems that may step between two segments: in the same slot, or before and after a segment too short to be detected.
LARGEST_MOVE: Final = 2
PER_SYSTEM: Final = 2.0  # prior log odds against each further system: equal steps are more likely one longer chain's
# Model error of a level, apart from noise, as a share of the base: visits too short to be detected, error of the drag's
# slope.
LEVEL_ERROR: Final = 0.002
BASE_SPREAD: Final = 0.02  # of the base, from one recording to another, before it is estimated
ENOUGH_JUMPS: Final = 1500  # to determine the number of systems; more only sharpen the estimates of each
# Passes, and paths kept in each: for every start, and for the KEPT_STARTS best of them.
QUICK: Final = (2, 12)
THOROUGH: Final = (12, 64)
KEPT_STARTS: Final = 2
CONVERGED: Final = 0.01  # of the log-likelihood
# Priors as pseudo-observations: PRIOR_SOJOURNS sojourns of width PRIOR_SIGMA (of the log duration), PRIOR_SIZES sizes
# of relative spread PRIOR_SPREAD. SIGMAS bound the width: a law neither as sharp as a clock nor broader than a decade.
PRIOR_SOJOURNS: Final = 2.0
PRIOR_SIGMA: Final = 0.7
PRIOR_SIZES: Final = 0.5
PRIOR_SPREAD: Final = 0.05
SIGMAS: Final = (0.05, 2.0)
CENSORED_EXCESS: Final = 0.3  # log ratio of the assumed to the observed duration of a sojourn that the record cuts
VISIT_JUMPS: Final = 8  # jumps after a jump up among which the one that cancels it is searched
CLOSED_WITHIN: Final = 3.5  # standard deviations by which the jump back may differ in size from the entry
START_SPREAD: Final = 0.3  # of a size, at the start
START_SIGMA: Final = 1.2  # of the log duration, at the start
START_STEPS: Final = (0.3, 0.5, 0.7)  # quantiles of the jumps' sizes that may be the step of a longer chain

# Largest share of the visits that may be another system's. The halves of one Gaussian population, split at its middle
# and taken for two, have 0.09; one visit in twenty shifts the median of a law by less than the sampling error of 100.
MOST_CONFUSED: Final = 0.05


class Segments(NamedTuple):
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


class Chains(NamedTuple):
    """Switching systems as estimated while jumps are attributed; arrays (systems, configurations), padded.

    Attributes
    ----------
    counts
        Configurations of each system.
    size, spread
        Mean and standard deviation of the friction above that of the lowest configuration [N m]; 0 in it.
    mu, sigma
        Mean and standard deviation of the logarithm of a sojourn's slots.
    up
        Probability that the next step goes up.
    base, base_std
        Friction with all at rest, and its standard deviation between records [N m].
    """

    counts: tuple[int, ...]
    size: FloatArray
    spread: FloatArray
    mu: FloatArray
    sigma: FloatArray
    up: FloatArray
    base: float
    base_std: float


class Path(NamedTuple):
    """The likeliest path of a record.

    Attributes
    ----------
    configurations
        int64 (k, systems).
    outlier
        bool (k,), segments whose level no system explains.
    log_likelihood
        Of levels and durations together.
    """

    configurations: IntArray
    outlier: BoolArray
    log_likelihood: float


_Description = tuple[float, Chains, list[Path]]  # criterion or log-likelihood, the systems, the path of each record


@dataclass(frozen=True, slots=True)
class Sojourn:
    """A sojourn in one configuration: its slots in the record, and whether it began and ended there."""

    slots: int
    began: bool
    ended: bool

    @property
    def whole(self) -> bool:
        """Whether the record holds all of it."""
        return self.began and self.ended


@dataclass(frozen=True, slots=True)
class Visit(Sojourn):
    """A sojourn of one system in one record.

    Attributes
    ----------
    configuration
        q.
    friction, std
        Above the base, and its standard deviation [N m]; 0 in the lowest configuration.
    record
        Its record.
    begin
        The slot in which it begins.
    """

    configuration: int
    friction: float
    std: float
    record: int
    begin: int


def ways_up(visits: Sequence[Visit], q: int) -> list[bool]:
    """Return for each transition from configuration q whether it goes up."""
    return [b.configuration > q for a, b in pairwise(visits) if a.configuration == q and a.record == b.record]


class JumpAttribution(NamedTuple):
    """Jumps attributed to systems.

    Attributes
    ----------
    chains
        The systems, as estimated.
    visits
        By system, in the order of time.
    base
        By record, friction with all at rest [N m], and the number of slots in which all are.
    alternatives
        Other descriptions, best first: configurations of the systems, and by how much their criterion is worse: the
        log-likelihood less half log n for each parameter.
    unexplained
        Share of the segments whose level no system explains.
    """

    chains: Chains
    visits: tuple[tuple[Visit, ...], ...]
    base: tuple[tuple[float, int], ...]
    alternatives: tuple[tuple[tuple[int, ...], float], ...]
    unexplained: float


def attribute_jumps(records: Sequence[Segments], base: float) -> JumpAttribution:
    """Attribute the jumps of a wheel's records to switching systems.

    Parameters
    ----------
    records
        The records, with a jump in at least one of them.
    base
        Friction of the lowest segments [N m].
    """
    records = [Segments(one.level, np.hypot(one.std, LEVEL_ERROR * abs(base)), one.at) for one in records]
    known = _described(_first_of(records, ENOUGH_JUMPS), base)
    order = sorted(known, key=lambda counts: -known[counts][0])
    while True:
        criterion, chains, _ = known[order[0]]
        _, chains, paths = _alternate(records, chains, *THOROUGH)
        visits, bases = _visits(records, chains, paths)
        if not _is_halved(chains, visits):
            break
        del order[0]
    unexplained = float(np.mean(np.concatenate([path.outlier for path in paths])))
    alternatives = tuple((counts, float(criterion - known[counts][0])) for counts in order[1:])
    return JumpAttribution(chains, visits, bases, alternatives, unexplained)


def _first_of(records: Sequence[Segments], jumps: int) -> list[Segments]:
    """Return the first records that together have `jumps` jumps, the last of them cut; or all records."""
    first: list[Segments] = []
    for one in records:
        segments = min(one.level.size, jumps + 1)
        first.append(Segments(one.level[:segments], one.std[:segments], one.at[: segments + 1]))
        jumps -= segments - 1
        if jumps <= 0:
            break
    return first


def _described(records: Sequence[Segments], base: float) -> dict[tuple[int, ...], _Description]:
    """Fit each number of systems and configurations to the records, tier by tier while the criterion improves.

    Returns the criterion, the systems and the paths by the numbers of configurations.
    """
    jumps = sum(one.level.size - 1 for one in records)
    known: dict[tuple[int, ...], _Description] = {}
    for tier in TIERS:
        before = max((value[0] for value in known.values()), default=-np.inf)
        for counts in tier:
            score, chains, paths = _best_of(records, counts, base)
            # Size and spread above the lowest configuration, two of each duration law, probabilities up in between.
            parameters = sum(2 * (count - 1) + 2 * count + (count - 2) for count in counts)
            penalty = 0.5 * parameters * np.log(jumps + 1) + (len(counts) - 1) * PER_SYSTEM
            known[counts] = score - penalty, chains, paths
        if max(value[0] for value in known.values()) <= before:
            break
    return known


def _best_of(records: Sequence[Segments], counts: tuple[int, ...], base: float) -> _Description:
    """Return the best description over all starts."""
    tried = [_alternate(records, start, *QUICK) for start in _starts(records, counts, base)]
    tried.sort(key=lambda one: -one[0])
    finished = [_alternate(records, chains, *THOROUGH) for _, chains, _ in tried[:KEPT_STARTS]]
    return max(finished, key=lambda one: one[0])


def _alternate(records: Sequence[Segments], chains: Chains, passes: int, beam: int) -> _Description:
    """Alternate decoding and estimation; return the best log-likelihood with its systems and paths."""
    best: _Description | None = None
    for _ in range(passes):
        paths = [decode(one, chains, beam) for one in records]
        score = sum(path.log_likelihood for path in paths)
        done = best is not None and score < best[0] + CONVERGED
        if best is None or score > best[0]:
            best = score, chains, paths
        if done:
            break
        visits, bases = _visits(records, chains, paths)
        chains = _estimated(chains, visits, bases)
    assert best is not None
    return best


def confused_share(chains: Chains, visits: Sequence[Sequence[Visit]], i: int, j: int) -> float:
    """Return the share of the visits of two systems of two configurations that may be the other's.

    The mean probability, by size and duration, that a visit belongs to the other of the two.
    """
    lots = {k: [visit for visit in visits[k] if visit.configuration == 1] for k in (i, j)}
    confusion = []
    for number, lot in enumerate(lots.values()):
        for visit in lot:
            score = []
            for k, others in lots.items():
                width = float(np.hypot(chains.spread[k, 1], visit.std))
                size = (visit.friction - chains.size[k, 1]) / width
                slots = (np.log(visit.slots) - chains.mu[k, 1]) / chains.sigma[k, 1]
                score.append(np.log(len(others) / (width * chains.sigma[k, 1])) - 0.5 * (size**2 + slots**2))
            confusion.append(1.0 - float(special.softmax(score)[number]))
    return float(np.mean(confusion))


def confused_pairs(chains: Chains, visits: Sequence[Sequence[Visit]]) -> Iterator[tuple[int, int, float]]:
    """Yield the pairs of systems of two configurations that share more visits than `MOST_CONFUSED`, and the share."""
    for i, j in combinations(range(len(chains.counts)), 2):
        if chains.counts[i] == chains.counts[j] == 2:
            share = confused_share(chains, visits, i, j)
            if share > MOST_CONFUSED:
                yield i, j, share


def _is_halved(chains: Chains, visits: Sequence[Sequence[Visit]]) -> bool:
    """Return whether two of the systems are one whose visits were split: similar, and never away from rest together.

    Choosing for each visit the half that it fits better overstates the likelihood of a description with one more
    system, the more so the more visits there are.
    """
    for i, j, _ in confused_pairs(chains, visits):
        away = sorted(
            (visit.record, visit.begin, visit.begin + visit.slots)
            for visit in (*visits[i], *visits[j])
            if visit.configuration
        )
        if not any(a[0] == b[0] and b[1] < a[2] for a, b in pairwise(away)):
            return True
    return False


# ---- the likeliest path ----------------------------------------------------------------------------------------------


def decode(segments: Segments, chains: Chains, beam: int) -> Path:
    """Return the likeliest path of a record.

    Parameters
    ----------
    segments
        The record, at least one segment.
    chains
        The systems.
    beam
        Number of paths kept.
    """
    counts = chains.counts
    configurations = np.array(list(product(*(range(count) for count in counts))), dtype=np.int64)
    moves = np.array(
        [move for move in product((0, 1, -1), repeat=len(counts)) if np.count_nonzero(move) <= LARGEST_MOVE],
        dtype=np.int64,
    )
    laws = (
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
    record = (segments.level, segments.std**2, segments.at)
    states = (configurations, _log_stationary(configurations, chains))
    found, outlier, value = likeliest_path(record, laws, states, moves, beam)
    return Path(found, outlier.view(np.bool_), value)


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


# ---- starts ----------------------------------------------------------------------------------------------------------


def _starts(records: Sequence[Segments], counts: tuple[int, ...], base: float) -> Iterator[Chains]:
    """Yield initial estimates of the systems.

    Systems of two configurations come from visits that close, grouped by size or by duration, into equal numbers or at
    the widest gaps; longer chains from the sizes of all jumps.
    """
    pairs = np.array([pair for one in records for pair in _closed(one)], dtype=np.float64).reshape(-1, 2)
    slots = sum(int(one.at[-1] - one.at[0]) for one in records)
    jumps = np.concatenate([np.abs(np.diff(one.level)) for one in records])
    if pairs.shape[0] < 2:
        pairs = np.array([[size, slots / (jumps.size + 1)] for size in np.quantile(jumps, (0.3, 0.7))])
    two = sum(count == 2 for count in counts)
    seen = set()
    for groups in _grouped(pairs, two):
        for steps in START_STEPS if two < len(counts) else (0.5,):
            chains = _start(counts, groups, float(np.quantile(jumps, steps)), slots / (jumps.size + 1), slots, base)
            key = (chains.size.tobytes(), chains.mu.tobytes())
            if key not in seen:
                seen.add(key)
                yield chains


def _closed(one: Segments) -> Iterator[tuple[float, float]]:
    """Yield size [N m] and slots of visits: from a jump up to the nearest jump down that cancels it."""
    size, std = np.diff(one.level), np.hypot(one.std[1:], one.std[:-1])
    free = np.ones(size.size, dtype=bool)
    for up in np.flatnonzero(size > 0).tolist():
        after = np.arange(up + 1, min(up + 1 + VISIT_JUMPS, size.size))
        undone = after[free[after] & (np.abs(size[after] + size[up]) < CLOSED_WITHIN * np.hypot(std[after], std[up]))]
        if undone.size:
            free[undone[0]] = False
            yield float(size[up]), float(one.at[undone[0] + 1] - one.at[up + 1])


def _grouped(pairs: FloatArray, groups: int) -> Iterator[list[FloatArray]]:
    """Yield ways to divide visits (n, 2), size and slots, into groups."""
    if groups == 0:
        yield []
        return
    if groups == 1 or pairs.shape[0] < groups:
        for quantile in (0.5, 0.2, 0.8) if groups == 1 else (0.5,):
            centre = np.quantile(np.log(pairs[:, 1]), quantile)
            near = pairs[np.argsort(np.abs(np.log(pairs[:, 1]) - centre))[: max(pairs.shape[0] // 2, 1)]]
            yield [near] * groups
        yield [pairs] * groups
        return
    for column in (0, 1):
        ordered = pairs[np.argsort(pairs[:, column], kind="stable")]
        yield np.array_split(ordered, groups)
        gaps = np.diff(np.log(ordered[:, column]))
        inner = gaps[1:-1] if gaps.size >= groups + 1 else gaps
        cuts = np.sort(np.argsort(-inner, kind="stable")[: groups - 1]) + (2 if inner.size < gaps.size else 1)
        yield np.split(ordered, cuts)


def _start(
    counts: tuple[int, ...], groups: list[FloatArray], step: float, mean_slots: float, slots: float, base: float
) -> Chains:
    """Return an initial estimate: systems of two configurations from their visits, longer chains from their step."""
    shape = len(counts), max(counts)
    size, mu, up = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    left = list(groups)
    for i, count in enumerate(counts):
        up[i, :count] = [1.0, *[0.5] * (count - 2), 0.0]
        if count == 2:
            group = left.pop(0)
            size[i, 1] = np.median(group[:, 0])
            mu[i, 1] = np.median(np.log(group[:, 1]))
            mu[i, 0] = np.log(max(slots / (group.shape[0] + 1) - np.exp(mu[i, 1]), mean_slots))
        else:
            size[i, :count] = step * np.arange(count)
            mu[i, :count] = np.log(mean_slots * len(counts))
    return Chains(counts, size, START_SPREAD * size, mu, np.full(shape, START_SIGMA), up, base, BASE_SPREAD * abs(base))


# ---- estimates -------------------------------------------------------------------------------------------------------


def _visits(
    records: Sequence[Segments], chains: Chains, paths: Sequence[Path]
) -> tuple[tuple[tuple[Visit, ...], ...], tuple[tuple[float, int], ...]]:
    """Return the visits of each system, and each record's base with the slots in which all systems are at rest."""
    of_all: list[list[Visit]] = [[] for _ in chains.counts]
    bases = []
    for number, (one, path) in enumerate(zip(records, paths, strict=True)):
        sojourns = [
            (i, begin, end, int(path.configurations[begin, i]))
            for i in range(len(chains.counts))
            for begin, end in _spans(path.configurations[:, i])
        ]
        friction, std, base = _frictions(one, chains, path, sojourns)
        for k, (i, begin, end, q) in enumerate(sojourns):
            slots, inside = int(one.at[end] - one.at[begin]), (begin > 0, end < one.level.size)
            of_all[i].append(Visit(slots, *inside, q, friction[k], std[k], number, int(one.at[begin])))
        at_rest = (path.configurations == 0).all(axis=1)
        bases.append((base, int(np.diff(one.at)[at_rest].sum())))
    return tuple(tuple(of_one) for of_one in of_all), tuple(bases)


def _spans(configuration: IntArray) -> list[tuple[int, int]]:
    """Return for each sojourn its first segment and the one after its last."""
    cuts = [0, *(np.flatnonzero(np.diff(configuration)) + 1).tolist(), configuration.size]
    return list(pairwise(cuts))


def _frictions(
    one: Segments, chains: Chains, path: Path, sojourns: Sequence[tuple[int, int, int, int]]
) -> tuple[list[float], list[float], float]:
    """Return friction and standard deviation of each sojourn, and the base [N m], by least squares given the path.

    `sojourns`: system, first segment, that after the last, and configuration; 0 where that is the lowest.
    """
    columns, prior, width, place = [np.ones(one.level.size)], [chains.base], [chains.base_std], []
    for i, begin, end, q in sojourns:
        if q:
            place.append(len(columns))
            column = np.zeros(one.level.size)
            column[begin:end] = 1.0
            columns.append(column)
            prior.append(chains.size[i, q])
            # A visit's size is its own: the law of the others is a wide prior for visits that are poorly measured.
            width.append(max(3.0 * chains.spread[i, q], PRIOR_SPREAD * chains.size[i, q]))
        else:
            place.append(-1)
    used = ~path.outlier
    design = np.column_stack(columns)[used] / one.std[used, None]
    gram = design.T @ design + np.diag(np.array(width) ** -2.0)
    target = design.T @ (one.level[used] / one.std[used]) + np.array(prior) / np.array(width) ** 2
    inverse = np.linalg.inv(gram)
    solution, error = (np.append(values, 0.0) for values in (inverse @ target, np.sqrt(inverse.diagonal())))
    return solution[place].tolist(), error[place].tolist(), float(solution[0])


def _estimated(chains: Chains, visits: Sequence[Sequence[Visit]], bases: Sequence[tuple[float, int]]) -> Chains:
    """Return the systems as estimated from their visits."""
    size, spread = np.zeros_like(chains.size), np.zeros_like(chains.size)
    mu, sigma, up = chains.mu.copy(), chains.sigma.copy(), chains.up.copy()
    for i, (count, of_one) in enumerate(zip(chains.counts, visits, strict=True)):
        for q in range(count):
            seen = [visit for visit in of_one if visit.configuration == q]
            mu[i, q], sigma[i, q] = _law(seen, chains.mu[i, q])
            if q:
                size[i, q], spread[i, q] = _size(seen, chains.size[i, q])
        for q in range(1, count - 1):
            ways = ways_up(of_one, q)
            up[i, q] = (sum(ways) + 1.0) / (len(ways) + 2.0)
    level = np.array([base for base, _ in bases])
    weight = np.array([slots + 1.0 for _, slots in bases])
    base = float(np.average(level, weights=weight))
    base_std = math.sqrt((np.sum((level - base) ** 2) + (BASE_SPREAD * base) ** 2) / (level.size + 1))
    return Chains(chains.counts, size, spread, mu, sigma, up, base, base_std)


def _law(seen: Sequence[Visit], before: float) -> tuple[float, float]:
    """Return mean and std of the log of the slots; sojourns that were cut count as somewhat longer than observed."""
    logs = np.array(
        [np.log(visit.slots) if visit.whole else max(np.log(visit.slots) + CENSORED_EXCESS, before) for visit in seen]
    )
    if not any(visit.whole for visit in seen):
        return (float(np.mean(logs)) if logs.size else before), START_SIGMA
    middle = float(np.mean(logs))
    squares = float(np.sum((logs - middle) ** 2)) + PRIOR_SOJOURNS * PRIOR_SIGMA**2
    return middle, float(np.clip(np.sqrt(squares / (logs.size + PRIOR_SOJOURNS)), *SIGMAS))


def _size(seen: Sequence[Visit], before: float) -> tuple[float, float]:
    """Return mean and spread of the friction of visits [N m], the spread without the visits' measurement errors."""
    if not seen:
        return before, START_SPREAD * before
    friction, std = np.array([visit.friction for visit in seen]), np.array([visit.std for visit in seen])
    weight = 1.0 / (std**2 + (PRIOR_SPREAD * before) ** 2)
    mean = max(float(np.average(friction, weights=weight)), 1e-3 * before)
    excess = float(np.sum(weight * ((friction - mean) ** 2 - std**2)) / np.sum(weight)) * len(seen)
    variance = (max(excess, 0.0) + PRIOR_SIZES * (PRIOR_SPREAD * mean) ** 2) / (len(seen) + PRIOR_SIZES)
    return mean, math.sqrt(variance)
