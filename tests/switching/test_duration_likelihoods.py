"""Log-probability tables: the chances of all that can happen in a window add up to one (errata 9)."""

from itertools import combinations, pairwise

import numpy as np
import pytest

from rwa_monitor.switching.carried_state import CarriedState, SystemState
from rwa_monitor.switching.duration_likelihoods import Onset, onsets, soft_survival_sum, tabulated_durations
from rwa_monitor.wheel.durations import Geometric, Histogram, Lognormal, Uniform, Weibull
from rwa_monitor.wheel.switching_systems import simulate_system
from rwa_monitor.wheel.wheel import SwitchingSystem
from tests.switching.assignment_windows import system as system_of

SYSTEMS = {
    "two uniform": SwitchingSystem(name="a", durations=(Uniform(low=3, high=6), Uniform(low=1, high=2))),
    "three, uneven": SwitchingSystem(
        name="b", durations=(Geometric(mean=3), Uniform(low=2, high=4), Lognormal(mu=1.0, sigma=0.4)), up=(1, 0.3, 0)
    ),
    "weibull and histogram": SwitchingSystem(
        name="c", durations=(Weibull(shape=1.5, scale=4.0), Histogram(edges=(1, 3, 8), weights=(1.0, 2.0)))
    ),
}


@pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS.keys())
@pytest.mark.parametrize(("slots", "first"), [(1, None), (4, None), (8, None), (7, Onset(0, 1)), (7, Onset(0, 4))])
def test_probabilities_of_a_window_add_up_to_one_also_after_earlier_ones(system, slots, first):
    """Every start and every set of jumps of one system in a window."""
    index = np.arange(1, slots)
    tables = tabulated_durations((system,), index, slots, (first,))
    total = 0.0
    for count in range(slots):
        for jumps in combinations(range(1, slots), count):
            for start in range(system.configurations):
                paths = [(start, 0.0)]
                nodes = (0, *jumps)
                for before, node in pairwise(nodes):
                    paths = [
                        (q + step, score + tables.jump[0, q, before, node] + tables.turn[0, q, direction])
                        for q, score in paths
                        for direction, step in ((0, -1), (1, 1))
                        if 0 <= q + step < system.configurations
                    ]
                total += sum(np.exp(score + tables.stay[0, q, nodes[-1]]) for q, score in paths)
    assert total == pytest.approx(1.0, abs=1e-9)


def test_first_sojourn_is_that_of_a_simulated_record():
    """Records begin in the stationary law: how long the first sojourn lasts is what the tables give."""
    system = system_of("a", Uniform(low=20, high=40), Uniform(low=5, high=10))
    slots, trials = 30, 4000
    tables = tabulated_durations((system,), np.arange(1, slots), slots, (None,))
    counts = np.zeros((2, slots))
    rng = np.random.default_rng(2)
    for _ in range(trials):
        record = simulate_system(system, slots, rng)
        end = record.jump_index[0] if record.jump_index.size else slots
        counts[record.configuration[0], end - 1] += 1
    expected = trials * np.exp(np.column_stack([tables.jump[0, :, 0, 1:], tables.stay[0, :, 0]]))
    # χ² over the cells that can be filled; soft shares are far below one count.
    filled = expected > 5
    chi2 = float(np.sum((counts - expected)[filled] ** 2 / expected[filled]))
    freedom = int(filled.sum()) - 1
    assert abs(chi2 - freedom) < 5 * np.sqrt(2 * freedom)


def test_soft_law_keeps_mean_and_allows_everything():
    law = Uniform(low=10_000, high=20_000)
    assert soft_survival_sum(law, 1) == pytest.approx(law.mean(), rel=1e-3)
    system, slots = SwitchingSystem(name="a", durations=(law, law)), 160_000
    table = tabulated_durations((system,), np.array([1, 2, 501, 80_001]), slots, (None,))
    assert np.isfinite(table.jump[0, 0, 1, 2:]).all()
    near = np.arange(79_000, 79_100)
    stay = tabulated_durations((system,), slots - near[::-1], slots, (None,)).stay[0, 0, 1:]
    assert soft_survival_sum(law, 79_000) - soft_survival_sum(law, 79_100) == pytest.approx(
        np.exp(stay).sum(), rel=1e-9
    )


def test_earlier_windows_tell_the_first_configuration():
    system = SYSTEMS["two uniform"]
    carried = CarriedState(fss=(SystemState(name="a", configuration=1, age=1, friction=(None, None)),))
    assert onsets((system,), carried) == (Onset(1, 1),)
    assert onsets((system,), None) == (None,)
    told = tabulated_durations((system,), np.array([1, 2]), 10, (Onset(1, 1),))
    plain = tabulated_durations((system,), np.array([1, 2]), 10, (None,))
    # Active for one slot already, two at most: it ends after one slot of this window.
    assert told.jump[0, 1, 0, 1] > np.log(0.9)
    assert told.jump[0, 1, 0, 1] > plain.jump[0, 1, 0, 1]
    assert told.stay[0, 0, 0] < plain.stay[0, 0, 0]
