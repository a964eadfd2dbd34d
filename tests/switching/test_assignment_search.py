"""The search against all assignments there are, one by one; its budget; its bounds."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest

from rwa_monitor.kernels.assignment import NO_SYSTEM, REJECT, add_up_laws, find_paths
from rwa_monitor.switching.assignment import Scores
from tests.switching.assignment_windows import FREE, LONG, SHORT, random_scores, step_of, without_sizes


@dataclass(frozen=True)
class Partial:
    """A part of an assignment, as far as it has been decided."""

    score: float
    last: int
    now: tuple[tuple[int, int], ...]  # configuration of each system, node at which its sojourn began
    friction: tuple[tuple[float, float], ...]  # mean and variance
    taken: tuple[int, ...] = ()


def follow(scores: Scores, before: Partial, k: int, number: int) -> Partial | None:
    """Score one action by the definition; None where it is impossible."""
    taken = (*before.taken, number)
    if number == REJECT:
        return replace(before, taken=taken)
    score = before.score + scores.fit[before.last, k]
    now, friction = list(before.now), list(before.friction)
    mean, variance = 0.0, 0.0
    row = scores.actions[number]
    pairs = [(int(s), *step_of(int(step))) for s, step in (row[:2], row[2:]) if s >= 0]
    if number == NO_SYSTEM:
        score += scores.unattributed
        variance = scores.unattributed_variance
    elif len({direction for _, direction, _ in pairs}) == 1 and not scores.signs[k - 1, max(pairs[0][1], 0)]:
        return None
    for s, direction, missed in pairs:
        (q, since), old = before.now[s], before.friction[s]
        middle, after = q + missed, q + missed + direction
        if not (0 <= middle < scores.configurations[s] and 0 <= after < scores.configurations[s]):
            return None
        table = scores.jump[s, q] if missed == 0 else scores.missed[s, q, max(missed, 0)]
        score += table[since, k] + scores.turn[s, middle, max(direction, 0)]
        now[s] = (after, k)
        if missed:
            hidden, spread = scores.law_mean[s, middle] - old[0], scores.law_variance[s, middle] + old[1]
            score -= 0.5 * hidden**2 / (spread + scores.size_variance[k - 1])
            old = (scores.law_mean[s, middle], scores.law_variance[s, middle])
        friction[s] = (scores.law_mean[s, after], scores.law_variance[s, after])
        mean += friction[s][0] - old[0]
        variance += friction[s][1] + old[1]
    if score == -np.inf:
        return None
    total = variance + scores.size_variance[k - 1]
    miss = scores.size[k - 1] - mean
    score += scores.log_range - 0.5 * np.log(2 * np.pi * total) - 0.5 * miss**2 / total
    for s, _, _ in pairs:
        law_mean, law_variance = friction[s]
        friction[s] = (law_mean + law_variance / total * miss, law_variance * (1 - law_variance / total))
    return Partial(score, k, tuple(now), tuple(friction), taken)


def all_scores(scores: Scores) -> Iterator[tuple[float, tuple[int, ...], tuple[int, ...]]]:
    """Go through every assignment and score it by the definition, without any merging or bound."""
    candidates = scores.signs.shape[0]

    def visit(k: int, so_far: Partial) -> Iterator[Partial]:
        if k > candidates:
            end = so_far.score + scores.fit[so_far.last, candidates + 1]
            end += sum(scores.stay[s, q, since] for s, (q, since) in enumerate(so_far.now))
            yield replace(so_far, score=float(end))
            return
        for number in range(len(scores.actions)):
            following = follow(scores, so_far, k, number)
            if following is not None:
                yield from visit(k + 1, following)

    for start in np.ndindex(*scores.configurations):
        configurations = tuple(int(q) for q in start)
        friction = tuple((scores.law_mean[s, q], scores.law_variance[s, q]) for s, q in enumerate(start))
        for end in visit(1, Partial(0.0, 0, tuple((q, 0) for q in configurations), friction)):
            yield end.score, configurations, end.taken


@pytest.mark.parametrize(
    ("systems", "candidates", "rare", "trials"),
    [
        ((), 7, True, 20),
        ((FREE,), 5, True, 20),
        ((SHORT, LONG), 4, True, 5),
        ((SHORT, LONG), 7, False, 1),
        ((SHORT, LONG, FREE), 3, True, 3),
    ],
    ids=["none", "one", "two", "two-plain", "three"],
)
def test_equals_exhaustive_search(systems, candidates, rare, trials):
    rng = np.random.default_rng(7)
    agree = 0
    for _ in range(trials):
        problem = random_scores(rng, systems, candidates, rare=rare)
        best = sorted(all_scores(problem), key=lambda one: -one[0])[:3]
        scores, starts, taken, _, pruned = find_paths(problem, 3, 1000.0, 100_000)
        assert not pruned
        found = list(zip(scores.tolist(), map(tuple, starts.tolist()), map(tuple, taken.tolist()), strict=True))
        # The three best, not only the best: they are distinct, and three are kept per state.
        np.testing.assert_allclose([one[0] for one in found], [one[0] for one in best], rtol=0, atol=1e-9)
        agree += found[0][1:] == best[0][1:]
    assert agree == trials


@pytest.mark.parametrize(
    ("systems", "candidates", "exact"),
    [((FREE,), 5, True), ((SHORT, FREE), 4, True), ((LONG,), 5, False), ((SHORT, LONG), 4, False)],
    ids=["one", "two", "three configurations", "both"],
)
def test_with_sizes_equals_exhaustive_search(systems, candidates, exact):
    """Sizes make the friction part of the path: exact for two configurations, nearly always right for more."""
    rng = np.random.default_rng(8)
    trials, agree = 12, 0
    for _ in range(trials):
        problem = random_scores(rng, systems, candidates, rare=not exact, sized=True)
        best = max(all_scores(problem))
        found = find_paths(problem, 16, 14.0, 100_000)[0][0]
        assert found <= best[0] + 1e-9
        agree += abs(found - best[0]) < 1e-9
    assert agree == trials if exact else agree >= trials - 1


def test_laws_of_a_path_are_its_score_without_fits_and_know_no_sizes():
    rng = np.random.default_rng(11)
    kinds = set()
    for _ in range(40):
        sized = random_scores(rng, (SHORT, LONG), 6, sized=True)
        paths = find_paths(without_sizes(sized), 8, 8.0, 20_000)[:3]
        for score, start, taken in zip(*paths, strict=True):
            nodes = np.concatenate([[0], np.flatnonzero(taken != REJECT) + 1, [taken.size + 1]])
            fits = float(sized.fit[nodes[:-1], nodes[1:]].sum())
            assert add_up_laws(sized, start, taken) == pytest.approx(score - fits, abs=1e-9)
            kinds.update(taken.tolist())
    assert {REJECT, NO_SYSTEM} < kinds
    assert len(kinds) >= 8  # with missed jumps or two at once: the sum holds for all


def test_narrow_margin_does_not_lose_the_best():
    rng = np.random.default_rng(11)
    for _ in range(30):
        problem = random_scores(rng, (SHORT, LONG), 10)
        [wide], _, _, of_wide, pruned = find_paths(problem, 1, 1000.0, 200_000)
        [narrow], _, _, of_narrow, _ = find_paths(problem, 1, 0.0, 200_000)
        assert not pruned
        assert narrow == wide
        assert of_narrow < of_wide


def test_pruning_is_reported_and_still_gives_a_whole_path():
    rng = np.random.default_rng(5)
    problem = random_scores(rng, (SHORT, LONG, FREE), 40)
    score, _, taken, _, pruned = find_paths(problem, 4, 30.0, 20)
    assert pruned
    assert taken.shape[1] == 40
    assert find_paths(problem, 4, 30.0, 4000)[0][0] >= score[0]
