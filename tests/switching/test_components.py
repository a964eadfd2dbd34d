"""Friction split into its parts: against simulated truth, uncertain where a window does not show it (errata 10)."""

import numpy as np
import pytest

from rwa_monitor.changepoints.estimation import SlopePrior
from rwa_monitor.changepoints.stage_results import Components, SwitchingPath
from rwa_monitor.switching.assignment import assign
from rwa_monitor.switching.carried_state import CarriedState, FrictionMemory, SystemState, Tracked
from rwa_monitor.switching.components import split
from rwa_monitor.switching.friction_model import measure, priors_of
from rwa_monitor.wheel.wheel import built_in_wheel
from tests.switching.assignment_windows import Window, sums_of, window

WHEEL = built_in_wheel()


def split_of(made: Window, carried: CarriedState | None = None) -> Components:
    assignment, levels = assign(made.evidence, WHEEL, carried)
    return split(assignment, levels, made.evidence, WHEEL, carried)


def windows(seed: int, count: int, *, rests: bool, **options: object) -> list[Window]:
    """Windows in which fss_2 rests at some time, or never does."""
    rng = np.random.default_rng(seed)
    found: list[Window] = []
    while len(found) < count:
        made = window(WHEEL, rng, false_candidates=0.5, jitter=0, **options)  # type: ignore[arg-type]
        if bool((made.configuration[1] == 0).any()) == rests:
            found.append(made)
    return found


def test_parts_are_those_simulated():
    for made in windows(40, 12, rests=True):
        parts = split_of(made)
        assert parts.viscous == pytest.approx(1.0, abs=0.01)
        assert parts.base_dry == pytest.approx(1.0, abs=max(5 * parts.base_dry_std, 0.005))
        assert parts.base_dry_std < 0.02
        starts = assign(made.evidence, WHEEL)[0].starts
        for s in range(2):
            middles = (starts[s] + np.append(starts[s][1:], made.z.size)) // 2
            assert parts.fss_friction[s] == pytest.approx(made.friction[s, middles], abs=0.04)
            assert (parts.fss_friction[s][made.configuration[s, middles] == 0] == 0).all()


def test_base_is_ambiguous_where_a_system_never_rests():
    errors, stds = [], []
    for made in windows(41, 10, rests=False):
        parts = split_of(made)
        errors.append(parts.base_dry - 1.0)
        stds.append(parts.base_dry_std)
    assert np.min(stds) > 0.01  # it states that it is uncertain
    assert np.sqrt(np.mean(np.square(errors))) < 3 * np.sqrt(np.mean(np.square(stds)))
    assert np.abs(errors).max() < 0.4  # and does not put a whole jump into the base


def test_earlier_windows_settle_what_is_ambiguous():
    memory = (None, FrictionMemory(count=20, mean=0.5, std=0.06), FrictionMemory(count=20, mean=1.0, std=0.11))
    carried = CarriedState(
        windows=10,
        base_dry=Tracked(mean=1.3, std=0.005, windows=10),
        fss=(SystemState(name="fss_1"), SystemState(name="fss_2", friction=memory)),
    )
    for made in windows(42, 5, rests=False, base=1.3):
        alone, told = split_of(made), split_of(made, carried)
        assert told.base_dry == pytest.approx(1.3, abs=0.06)
        assert told.base_dry_std < 0.5 * alone.base_dry_std


def test_what_the_samples_alone_show_is_the_integral_over_flat_priors():
    """Base and friction integrated on a grid, the likelihood of the segment means taken directly."""
    rng = np.random.default_rng(46)
    slots, std = 60, 0.3
    x, z = rng.uniform(0.3, 1.0, slots), rng.normal(1.5, 0.5, slots)
    priors = priors_of(WHEEL, None, 1.0, 0.5)._replace(slope=SlopePrior(0.0, 1e-9))
    rest, grid = np.zeros(1, dtype=np.int64), np.linspace(-4.0, 6.0, 401)
    none = np.zeros(0, dtype=np.int64)
    step = grid[1] - grid[0]

    def log_integral(levels: np.ndarray, borders: np.ndarray) -> float:
        """Levels of the segments, float64 (segments, ...), on a grid of the unknowns of step `step`."""
        log_likelihood = np.zeros(levels.shape[1:])
        for level, a, b in zip(levels, borders[:-1], borders[1:], strict=True):
            log_likelihood -= 0.5 * ((z[a:b, None] - level.ravel()) ** 2).sum(axis=0).reshape(level.shape) / std**2
        return float(np.logaddexp.reduce(log_likelihood, axis=None) + log_likelihood.ndim * np.log(step))

    def log_measured(configurations: tuple[int, ...], starts: tuple[int, ...], borders: np.ndarray) -> float:
        path = SwitchingPath.of((rest, np.array(configurations)), (rest, np.array(starts)), none)
        segments = sums_of(x, z).between(borders[:-1], borders[1:])
        return measure(path, borders, segments, priors, std**2, 1e-12).log_evidence

    base, first = np.meshgrid(grid, grid, indexing="ij")
    borders = np.array([0, 20, 60])
    # Up from rest: base and one sojourn. Always awake: two levels, and the shift between base and system left open.
    entered = log_measured((0, 1), (0, 20), borders) - log_integral(np.stack([base, base + first]), borders)
    awake = log_measured((1, 2), (0, 20), borders) - log_integral(np.stack([base, first]), borders)
    back = np.array([0, 20, 40, 60])
    returned = log_measured((0, 1, 0), (0, 20, 40), back) - log_integral(np.stack([base, base + first, base]), back)
    assert entered == pytest.approx(awake, abs=0.01)
    assert entered == pytest.approx(returned, abs=0.01)
