"""The compiled inner loops of `assignment_search`: states expanded candidate by candidate, merged, pruned by bounds.

A state is a row of small integers: the node of the last accepted changepoint, then for each system its configuration
and the node at which its sojourn began. Of each state the best few entries (score, parent, action) are kept. Plain
functions over arrays; sums are taken in a fixed order, so that results are the same on every machine.

While the extensions of a stage are listed, those that more others have beaten than there is room for are left out: most
of what follows is then beaten before it is weighed. What is kept, and whether the search says it pruned, is the same.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rwa_monitor.diagnosis.assignment_bounds import NO_SYSTEM, REJECT, SKIPPED, STEPS, Bounds, Scores, size_term
from rwa_monitor.samples import FloatArray

WORTH_THINNING: Final = 500  # offers from which it pays to leave out those that others have beaten
SLACK: Final = 1e-9  # of a first sieve, whose terms are added up in another order [log-likelihood]

Int16Array = NDArray[np.int16]
Int32Array = NDArray[np.int32]


class Entries(NamedTuple):
    """Entries of the current stage: states, scores, nodes in the tree, friction of each system (mean, variance)."""

    rows: Int16Array
    score: FloatArray
    node: Int32Array
    friction: FloatArray


class Offers(NamedTuple):
    """Extensions of the current entries, and the bound of the complete paths through them."""

    entry: Int32Array
    action: Int32Array
    score: FloatArray
    bound: FloatArray


class States(NamedTuple):
    """Distinct states of the next stage, each with its best offers, best first; `table` finds a state by its hash."""

    table: Int32Array
    rows: Int16Array
    kept: Int32Array
    score: FloatArray
    entry: Int32Array
    action: Int32Array


class Tree(NamedTuple):
    """All entries ever kept, to trace paths back: the entry before, and the action (at the root: the start)."""

    parent: Int32Array
    action: Int32Array


@njit(cache=True, error_model="numpy", nogil=True)
def expand(
    scores: Scores, bounds: Bounds, cutoff: float, budget: int, kept: int
) -> tuple[Int32Array, Int32Array, Int32Array, FloatArray, int, float]:
    """Expand all states candidate by candidate.

    Parameters
    ----------
    scores, bounds
        The scores, and upper bounds of what can follow.
    cutoff
        Extensions whose bound is below it are dropped.
    budget
        Extensions kept per candidate at most; past it the best by their bound.
    kept
        Entries kept per state.

    Returns
    -------
    tuple
        The tree (parent, action), the complete paths (their last node in the tree, their score), the number of entries
        expanded, and the highest bound of what the budget cut: better paths than that were not missed.
    """
    candidates, systems = scores.signs.shape[0], scores.configurations.size
    width = 1 + 2 * systems
    starts = 1
    for s in range(systems):
        starts *= scores.configurations[s]
    room = max(budget, starts)
    slots = 16
    while slots < 2 * room:
        slots *= 2
    most = room * scores.actions.shape[0]
    tree = Tree(np.empty((candidates + 1) * room, dtype=np.int32), np.empty((candidates + 1) * room, dtype=np.int32))
    entries, following = _no_entries(room, systems), _no_entries(room, systems)
    offers = Offers(np.empty(most, dtype=np.int32), np.empty(most, dtype=np.int32), np.empty(most), np.empty(most))
    states = States(
        np.empty(slots, dtype=np.int32),
        np.empty((room, width), dtype=np.int16),
        np.empty(room, dtype=np.int32),
        np.empty((room, kept)),
        np.empty((room, kept), dtype=np.int32),
        np.empty((room, kept), dtype=np.int32),
    )
    count = _start(scores, bounds, cutoff, starts, entries, tree)
    used, expanded, lost = count, 0, -np.inf
    for k in range(1, candidates + 1):
        # One more than there is room for: the best that is cut tells whether the search missed anything.
        offered = _offer(scores, bounds, k, cutoff, room + 1, entries, count, offers)
        expanded += count
        stage_cutoff = cutoff
        if offered > room:
            divided = np.partition(offers.bound[:offered], offered - room)
            stage_cutoff = divided[offered - room]
            lost = max(lost, divided[: offered - room].max())
        found = _merge(scores, k, stage_cutoff, entries, offers, offered, states)
        count = 0
        for state in range(found):
            for rank in range(states.kept[state]):
                at, action = states.entry[state, rank], states.action[state, rank]
                for column in range(width):
                    following.rows[count, column] = states.rows[state, column]
                _learn(scores, entries, at, k, action, following.friction, count)
                following.score[count] = states.score[state, rank]
                following.node[count] = used
                tree.parent[used] = entries.node[at]
                tree.action[used] = action
                used += 1
                count += 1
        entries, following = following, entries
    for at in range(count):
        entries.score[at] += scores.fit[entries.rows[at, 0], candidates + 1]
        for s in range(systems):
            entries.score[at] += scores.stay[s, entries.rows[at, 1 + 2 * s], entries.rows[at, 2 + 2 * s]]
    return tree.parent[:used], tree.action[:used], entries.node[:count], entries.score[:count], expanded, lost


@njit(cache=True, error_model="numpy", nogil=True)
def _no_entries(room: int, systems: int) -> Entries:
    """Return room for entries."""
    return Entries(
        np.empty((room, 1 + 2 * systems), dtype=np.int16),
        np.empty(room),
        np.empty(room, dtype=np.int32),
        np.empty((room, systems, 2)),
    )


@njit(cache=True, error_model="numpy", nogil=True)
def _start(scores: Scores, bounds: Bounds, cutoff: float, starts: int, entries: Entries, tree: Tree) -> int:
    """Enter all configurations that the systems may be in at the window's begin; return their number."""
    count = 0
    for start in range(starts):
        remainder = start
        entries.rows[count, 0] = 0
        entries.score[count] = 0.0
        for s in range(scores.configurations.size - 1, -1, -1):
            q = remainder % scores.configurations[s]
            entries.rows[count, 1 + 2 * s] = q
            entries.rows[count, 2 + 2 * s] = 0
            entries.friction[count, s, 0] = scores.law_mean[s, q]
            entries.friction[count, s, 1] = scores.law_variance[s, q]
            remainder //= scores.configurations[s]
        if _bound(scores, bounds, entries.rows, count, 0) >= cutoff:
            tree.parent[count] = -1
            tree.action[count] = start
            entries.node[count] = count
            count += 1
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def _offer(
    scores: Scores, bounds: Bounds, k: int, cutoff: float, wanted: int, entries: Entries, count: int, offers: Offers
) -> int:
    """List what may happen to each entry at candidate k and is within reach of the best; return the number.

    All of the `wanted` best by their bound are among them, those that tie with the last of these too.
    """
    systems = scores.configurations.size
    fit, rest, rest_fit, signs, actions = scores.fit, bounds.rest, bounds.rest_fit, scores.signs, scores.actions
    steps = np.empty((systems, STEPS, 4))  # log-probability, change of the own bound, mean and variance of the jump
    unattributed = scores.priors[1] + size_term(scores, k, 0.0, scores.unattributed_variance)
    highest = size_term(scores, k, scores.size[k - 1], 0.0)
    offered, full = 0, wanted + max(wanted, WORTH_THINNING)
    for at in range(count):
        if offered >= full:  # most of what follows is then out of reach before it is weighed
            cutoff = max(cutoff, np.partition(offers.bound[:offered], offered - wanted)[offered - wanted])
            offered = _thin(offers, offered, cutoff)
            full = offered + max(wanted, WORTH_THINNING)
        last, so_far = entries.rows[at, 0], entries.score[at]
        by_own = 0.0  # what the systems may still do without a step here
        for s in range(systems):
            by_own += bounds.own[s, entries.rows[at, 1 + 2 * s], entries.rows[at, 2 + 2 * s], k]
        if by_own == -np.inf:
            continue
        score = so_far + scores.priors[0]
        bound = score + min(rest[last, k], rest_fit[last, k] + by_own)
        if bound >= cutoff:
            offered = _list(offers, offered, at, REJECT, score, bound)
        score = so_far + (fit[last, k] + unattributed)
        bound = score + min(rest[k, k], rest_fit[k, k] + by_own)
        if bound >= cutoff and bound > -np.inf:
            offered = _list(offers, offered, at, NO_SYSTEM, score, bound)
        # Most steps end here, before they are weighed: not even a perfect size would bring them within reach.
        best = so_far + fit[last, k] + highest + rest[k, k]
        if best < cutoff - SLACK:
            continue
        _weigh_steps(scores, bounds, entries, at, k, steps)
        for a in range(NO_SYSTEM + 1, actions.shape[0]):
            s, first, t, second = actions[a, 0], actions[a, 1], actions[a, 2], actions[a, 3]
            if best + steps[s, first, 0] < cutoff - SLACK or steps[s, first, 0] == -np.inf:
                continue
            if (second < 0 or first % 2 == second % 2) and not signs[k - 1, first % 2]:
                continue
            score = so_far + (fit[last, k] + steps[s, first, 0])
            own = by_own + steps[s, first, 1]
            mean, variance = steps[s, first, 2], steps[s, first, 3]
            if second >= 0:
                if steps[t, second, 0] == -np.inf:
                    continue
                score += steps[t, second, 0] + scores.priors[2]
                own += steps[t, second, 1]
                mean += steps[t, second, 2]
                variance += steps[t, second, 3]
            follows = min(rest[k, k], rest_fit[k, k] + own)
            if score + highest + follows < cutoff:
                continue
            score += size_term(scores, k, mean, variance)
            bound = score + follows
            if bound >= cutoff and bound > -np.inf:
                offered = _list(offers, offered, at, a, score, bound)
    return offered


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _list(offers: Offers, offered: int, at: int, action: int, score: float, bound: float) -> int:
    """Add an offer; return how many there are now."""
    offers.entry[offered], offers.action[offered] = at, action
    offers.score[offered], offers.bound[offered] = score, bound
    return offered + 1


@njit(cache=True, error_model="numpy", nogil=True)
def _thin(offers: Offers, offered: int, cutoff: float) -> int:
    """Leave out the offers whose bound is below the cutoff, the others in their order; return their number."""
    kept = 0
    for offer in range(offered):
        if offers.bound[offer] >= cutoff:
            offers.entry[kept], offers.action[kept] = offers.entry[offer], offers.action[offer]
            offers.score[kept], offers.bound[kept] = offers.score[offer], offers.bound[offer]
            kept += 1
    return kept


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _weigh_steps(scores: Scores, bounds: Bounds, entries: Entries, at: int, k: int, steps: FloatArray) -> None:
    """Fill in what each step of each system is worth, see `_offer`; -inf where it is impossible."""
    jump, missed, turn, own = scores.jump, scores.missed, scores.turn, bounds.own
    for s in range(scores.configurations.size):
        q, since = entries.rows[at, 1 + 2 * s], entries.rows[at, 2 + 2 * s]
        now = own[s, q, since, k]
        for step in range(STEPS):
            steps[s, step, 0] = -np.inf
            for column in range(1, 4):
                steps[s, step, column] = 0.0
            direction, skipped = step % 2, step // 2
            before = q + SKIPPED[skipped]
            after = before + 2 * direction - 1
            if min(before, after) < 0 or max(before, after) >= scores.configurations[s]:
                continue
            if skipped == 0:
                law = jump[s, q, since, k]
                mean, variance = entries.friction[at, s, 0], entries.friction[at, s, 1]
            else:
                law = missed[s, q, skipped - 1, since, k]
                mean, variance = scores.law_mean[s, before], scores.law_variance[s, before]
                if scores.sized:  # no candidate, so no change of level that could be seen
                    hidden = mean - entries.friction[at, s, 0]
                    law -= 0.5 * hidden**2 / (variance + entries.friction[at, s, 1] + scores.size_variance[k - 1])
            steps[s, step, 0] = law + turn[s, before, direction]
            steps[s, step, 1] = own[s, after, k, k] - now
            steps[s, step, 2] = scores.law_mean[s, after] - mean
            steps[s, step, 3] = scores.law_variance[s, after] + variance


@njit(cache=True, error_model="numpy", nogil=True)
def _merge(
    scores: Scores, k: int, cutoff: float, entries: Entries, offers: Offers, offered: int, states: States
) -> int:
    """Bring the offers above the cutoff together by state; return the number of states."""
    room, mask = states.rows.shape[0], states.table.size - 1
    out = np.zeros((1, entries.rows.shape[1]), dtype=np.int16)
    states.table[:] = -1
    found, taken = 0, 0
    for offer in range(offered):
        if offers.bound[offer] < cutoff or taken == room:
            continue
        taken += 1
        at, a = offers.entry[offer], offers.action[offer]
        _move(scores, entries, at, k, a, out)
        place = _hash(out) & mask
        while states.table[place] >= 0 and not _equal(states.rows, states.table[place], out):
            place = (place + 1) & mask
        if states.table[place] < 0:
            states.table[place] = found
            for column in range(out.shape[1]):
                states.rows[found, column] = out[0, column]
            states.kept[found] = 0
            found += 1
        state, score = states.table[place], offers.score[offer]
        if states.kept[state] < states.score.shape[1] or score > states.score[state, states.score.shape[1] - 1]:
            _keep(states, state, score, at, a)
    return found


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _keep(states: States, state: int, score: float, entry: int, action: int) -> None:
    """Put an offer, which belongs there, among the best of its state."""
    kept, place = states.score.shape[1], states.kept[state]
    if place == kept:
        place -= 1
    else:
        states.kept[state] += 1
    while place > 0 and states.score[state, place - 1] < score:
        states.score[state, place] = states.score[state, place - 1]
        states.entry[state, place] = states.entry[state, place - 1]
        states.action[state, place] = states.action[state, place - 1]
        place -= 1
    states.score[state, place], states.entry[state, place], states.action[state, place] = score, entry, action


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _move(scores: Scores, entries: Entries, at: int, k: int, a: int, out: Int16Array) -> None:
    """Write the state that action `a` at candidate k makes of an entry."""
    rows, actions = entries.rows, scores.actions
    for column in range(rows.shape[1]):
        out[0, column] = rows[at, column]
    if a == REJECT:
        return
    out[0, 0] = k
    for place in (0, 2):
        s, step = actions[a, place], actions[a, place + 1]
        if s >= 0:
            out[0, 1 + 2 * s] = rows[at, 1 + 2 * s] + SKIPPED[step // 2] + 2 * (step % 2) - 1
            out[0, 2 + 2 * s] = k


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _learn(scores: Scores, entries: Entries, at: int, k: int, a: int, friction: FloatArray, to: int) -> None:
    """Write the friction of each system after action `a` at candidate k.

    The jump's size tells the new friction: the law's mean and variance are conditioned on it (a scalar Kalman step).
    """
    rows, actions = entries.rows, scores.actions
    for s in range(friction.shape[1]):
        friction[to, s, 0], friction[to, s, 1] = entries.friction[at, s, 0], entries.friction[at, s, 1]
    if a == REJECT:
        return
    surprise, total = scores.size[k - 1], scores.size_variance[k - 1]
    for place in (0, 2):
        s, step = actions[a, place], actions[a, place + 1]
        if s < 0:
            continue
        before = rows[at, 1 + 2 * s] + SKIPPED[step // 2]
        after = before + 2 * (step % 2) - 1
        if step // 2 == 0:
            surprise += friction[to, s, 0]
            total += friction[to, s, 1]
        else:
            surprise += scores.law_mean[s, before]
            total += scores.law_variance[s, before]
        friction[to, s, 0], friction[to, s, 1] = scores.law_mean[s, after], scores.law_variance[s, after]
        surprise -= friction[to, s, 0]
        total += friction[to, s, 1]
    for place in (0, 2):
        s = actions[a, place]
        if s >= 0 and scores.sized:
            share = friction[to, s, 1] / total
            friction[to, s, 0] += share * surprise
            friction[to, s, 1] *= 1.0 - share


@njit(cache=True, error_model="numpy", nogil=True)
def _bound(scores: Scores, bounds: Bounds, rows: Int16Array, at: int, k: int) -> float:
    """Return an upper bound of what can follow a state when candidates up to k are decided."""
    last = rows[at, 0]
    by_own = bounds.rest_fit[last, k]
    for s in range(scores.configurations.size):
        by_own += bounds.own[s, rows[at, 1 + 2 * s], rows[at, 2 + 2 * s], k]
    return float(min(bounds.rest[last, k], by_own))


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _hash(row: Int16Array) -> int:
    """Return a number ≥ 0 that scatters states over a table (FNV-1a over the columns)."""
    key = np.uint64(1469598103934665603)
    for column in range(row.shape[1]):
        key = (key ^ np.uint64(row[0, column])) * np.uint64(1099511628211)
    return np.int64((key ^ (key >> np.uint64(29))) >> np.uint64(1))  # type: ignore[return-value]


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _equal(rows: Int16Array, at: int, row: Int16Array) -> bool:
    """Whether state `at` is `row`."""
    for column in range(row.shape[1]):  # noqa: SIM110  (compiled: a generator would allocate)
        if rows[at, column] != row[0, column]:
            return False
    return True
