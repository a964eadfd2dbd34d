"""The kernels over paths and levels of stage 3 against the same in plain Python and numpy."""

from itertools import pairwise

import numpy as np
import pytest

from rwa_monitor.changepoints import estimation
from rwa_monitor.changepoints.noise import median_size
from rwa_monitor.changepoints.stage_results import Candidates, SwitchingPath
from rwa_monitor.diagnosis.model import built_in_model, stray_probabilities
from rwa_monitor.kernels.assignment import PREFERENCE, refine_nodes
from rwa_monitor.kernels.friction import evidence_of_cases, solve_cases
from rwa_monitor.kernels.laws import densities
from rwa_monitor.switching.friction_model import Cases
from tests.switching.assignment_windows import record_of, sums_of


def test_levels_without_samples_leave_the_sign_to_the_contrast():
    x, used = np.ones(300), np.ones(300, dtype=np.bool_)
    used[100:200] = False
    sums = sums_of(x, np.where(np.arange(300) < 150, 1.0, 2.0), used)
    index = np.array([100, 200])
    level = estimation.measure_level(index, np.array([0, 1]), sums, 1.0, 0.0, 1e-6)
    candidates = Candidates(index, np.full(2, 16), np.full(2, 50.0), np.array([0.5, 0.5]))
    signs = estimation.possible_signs(candidates, level)
    assert signs.tolist() == [[False, True], [False, True]]
    assert median_size(np.array([np.nan, -0.5, 0.1, 0.3])) == pytest.approx(0.3)
    assert median_size(np.array([np.nan])) == 0.0


@pytest.mark.parametrize("spread", [(0.0, 0.0), (0.3, 0.0), (0.2, 0.7)])
def test_the_posterior_is_that_of_the_normal_equations(spread):
    """Mean, covariance and evidence against dense linear algebra; with a spread, sojourns vary together."""
    rng = np.random.default_rng(14)
    configurations, starts = np.array([0, 1, 0, 1, 1, 2, 1]), np.array([0, 100, 250, 400, 0, 180, 330])
    system, alone, slope_at = np.array([0, 0, 0, 0, 1, 1, 1]), 500, 7
    table = np.array([[[0.0, 0.0], [0.5, 0.1], [0.0, 0.0]], [[0.1, 0.2], [0.6, 0.3], [1.1, 0.2]]])
    borders = np.array([0, 100, 180, 250, 330, 400, alone, 600])
    column = np.array([-1, 1, -1, 2, 3, 4, 5])
    ends = np.array([100, 250, 400, 600, 180, 330, 600])
    levels = np.zeros((7, 7))
    levels[:, 0], levels[-1, 6] = 1.0, 1.0
    for begin, end, place in zip(starts, ends, column, strict=True):
        if place >= 0:
            levels[(borders[:-1] >= begin) & (borders[1:] <= end), place] = 1.0
    # The prior: base, friction of each sojourn (1 + a) (mid + scatter), the jump that no system made, the slope.
    base, anomaly, rest = (1.2, 0.3), np.array([[0.1, spread[0]], [-0.2, spread[1]]]), np.array([0.4, 0.9, 0.2])
    free = column >= 0
    mid, scatter_of = table[system, configurations][free].T
    factor, own = 1.0 + anomaly[system[free], 0], anomaly[system[free], 1] * mid
    mean = np.concatenate([[base[0]], factor * mid, [0.0, rest[1]]])
    prior = np.diag(np.concatenate([[base[1]], factor * scatter_of, [rest[0], rest[2]]]) ** 2)
    prior[1:6, 1:6] += np.outer(own, own) * np.equal.outer(system[free], system[free])
    # Sums of segments whose samples spread about their means by `squares`, uncorrelated.
    variance, scatter, count = 0.04, 0.01, 7
    n, x, z = rng.integers(1, 200, count).astype(np.float64), rng.uniform(0.3, 1.0, count), rng.normal(1.0, 0.5, count)
    squares = rng.uniform(0.5, 1.0, (2, count))
    statistics = np.stack([n, n * x, n * z, n * x * x + squares[0], n * x * z, n * z * z + squares[1]])
    rows = np.concatenate([np.concatenate([levels, x[:, None]], axis=1), np.zeros((count, 8))])
    rows[count:, slope_at] = np.sqrt(squares[0])
    noise = np.concatenate([variance / n + scatter, np.full(count, variance)])
    gram = rows @ prior @ rows.T + np.diag(noise)
    miss = np.concatenate([z, np.zeros(count)]) - rows @ mean
    expected = mean + prior @ rows.T @ np.linalg.solve(gram, miss)
    covariance = prior - prior @ rows.T @ np.linalg.solve(gram, rows @ prior)
    evidence = -0.5 * miss @ np.linalg.solve(gram, miss) - 0.5 * np.linalg.slogdet(gram)[1]
    evidence -= 0.5 * squares[1].sum() / variance - 0.5 * (np.log(variance / n).sum() + count * np.log(variance))
    path = SwitchingPath(configurations, starts, np.array([4, 3]), np.array([alone]))
    cases = Cases(table, np.array([[base, *anomaly]]), np.zeros((1, 3), dtype=np.int64), np.zeros(1), rest)
    found = solve_cases(path, borders, statistics, cases, variance, scatter)
    assert found[0] == pytest.approx(evidence, rel=1e-9)
    assert found[1] == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert found[2] == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-9)
    assert found[3] == pytest.approx(covariance, rel=1e-9, abs=1e-12)
    assert found[4].tolist() == column.tolist()
    # The mixture of this case and one with another base.
    states, log_prior = np.array([[base, *anomaly], [(1.5, 0.4), *anomaly]]), np.log([0.3, 0.7])
    alone = cases._replace(states=states[1:])
    each = [found, solve_cases(path, borders, statistics, alone, variance, scatter)]
    both = Cases(table, states, np.array([[0, 0, 0], [1, 0, 0]]), log_prior, rest)
    evidence, mean, _, covariance, _ = solve_cases(path, borders, statistics, both, variance, scatter)
    scores = log_prior + [one[0] for one in each]
    weights = np.exp(scores - np.logaddexp(*scores))
    apart = [one[1] - mean for one in each]
    spread = sum(w * (one[3] + np.outer(off, off)) for w, one, off in zip(weights, each, apart, strict=True))
    assert evidence == pytest.approx(np.logaddexp(*scores), rel=1e-12)
    assert evidence_of_cases(path, borders, statistics, both, variance, scatter) == pytest.approx(evidence, rel=1e-12)
    assert mean == pytest.approx(weights @ [one[1] for one in each], rel=1e-9, abs=1e-12)
    assert covariance == pytest.approx(spread, rel=1e-9, abs=1e-12)


def test_values_that_are_not_known_have_no_density():
    model = built_in_model().anomalies[3]
    configuration, friction = np.array([0, 1, 2, 1, 9]), np.array([0.5, 0.5, 1.0, np.nan, 0.5])
    std, offset = np.full(5, 0.05), np.linspace(-0.2, 0.2, 5)
    found = densities(configuration, friction, std, offset, model.numbers)
    for k, known in enumerate([model.levels[0] is not None, True, True, False, False]):
        assert np.isfinite(found[2, k]).all() == known
        assert known or (found[:2, k] == 1.0).all()
    for k in (1, 2):  # as of one level, the offset added to the value
        level, spread = np.zeros(5, dtype=np.int64), np.full(5, std[k])
        one = densities(level, friction[k] + offset, spread, np.zeros(1), model.levels[configuration[k]].numbers[None])
        assert found[:, k] == pytest.approx(one[:, :, 0], rel=1e-12)
    stray, relative = stray_probabilities(model, configuration, friction, std)
    assert stray == pytest.approx(found[2, 1:3, 2], rel=1e-12)
    assert relative == pytest.approx([0.05 / model.levels[q].reach for q in (1, 2)], rel=1e-12)


# ---- levels and positions over the samples themselves ---------------------------------------------------------------


SLOTS, STD, SLOPE = 4_000, 0.024, 1.1
INDEX = np.array([320, 1_003, 1_040, 2_500, 3_900])
# A window with five jumps, a tenth of its samples masked.
RECORD = record_of(71, SLOTS, zip(INDEX.tolist(), (0.4, -0.3, 0.5, -0.6, 0.2), strict=True), 0.9)


def _error(values: np.ndarray) -> float:
    return float(((values - values.mean()) ** 2).sum()) if values.size else 0.0


def test_jumps_and_levels_are_those_of_the_samples():
    x, z, used = RECORD
    pairs = estimation.measure_level(INDEX, np.array([0, 2]), sums_of(x, z, used), STD**2, 0.0, 1.0).pairs
    nodes = np.array([0, 1, 3, 6])  # the first and the third candidate are accepted
    borders = np.concatenate([[0], INDEX, [SLOTS]])
    residual = np.where(used, z - SLOPE * x, np.nan)
    levels = estimation.levels_of(pairs, nodes, SLOPE)
    plain = [np.nanmean(residual[borders[a] : borders[b]]) for a, b in pairwise(nodes)]
    assert levels == pytest.approx(plain, rel=1e-10)
    jump, variance = estimation.jumps_of(pairs, nodes, SLOPE, 1e4, STD**2)
    for k, (before, after) in enumerate([(0, 3), (1, 3), (1, 6), (3, 6), (3, 6)], start=1):
        left, right = slice(borders[before], borders[k]), slice(borders[k], borders[after])
        assert jump[k - 1] == pytest.approx(np.nanmean(residual[right]) - np.nanmean(residual[left]), rel=1e-9)
        apart = x[right][used[right]].mean() - x[left][used[left]].mean()
        own = STD**2 * (1.0 / used[left].sum() + 1.0 / used[right].sum() + 2.0 * estimation.LEVEL_SCATTER**2)
        assert variance[k - 1] == pytest.approx(own + apart**2 / 1e4, rel=1e-9)


def test_positions_are_refined_to_the_least_error():
    x, z, used = RECORD
    index, reach = INDEX + np.array([7, -9, 5, 20, -3]), np.array([8, 16, 16, 32, 32])
    refined = refine_nodes(np.concatenate(([0], index, [SLOTS])), reach, SLOPE, STD**2, sums_of(x, z, used).arrays)
    residual, borders = z - SLOPE * x, np.concatenate([[0], index, [SLOTS]])
    for i, at in enumerate(index):
        left, right = borders[i], borders[i + 2]
        low = max(left + (at - left) // 2, at - reach[i])
        high = min(at + (right - at) // 2, at + reach[i])
        trials = [k for k in range(low, high + 1) if k > low or k == at]
        cost = [
            (_error(residual[left:k][used[left:k]]) + _error(residual[k:right][used[k:right]])) / (2.0 * STD**2)
            + PREFERENCE * abs(k - at)
            for k in trials
        ]
        assert refined[i] == trials[int(np.argmin(cost))]
