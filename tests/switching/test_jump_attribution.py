"""Jumps attributed to switching systems: right where size, duration or closing separate them, else refused."""

from dataclasses import dataclass

import numpy as np
import pytest

from rwa_monitor.errors import InputError
from rwa_monitor.identification.identify import check_distinguished
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.switching.jump_attribution import (
    Chains,
    JumpAttribution,
    Segments,
    attribute_jumps,
    confused_share,
    decode,
)

BASE = 1.6e-3  # N m
NOISE = 0.024  # of the base, of one sample
SLOTS = 60_000  # of a record
HOURS = 20.0  # of recordings; only words depend on it


@dataclass(frozen=True)
class Truth:
    """A system: medians of its sojourns [slots], their width in the logarithm, ranges of friction in the base."""

    medians: tuple[float, ...]
    width: float
    friction: tuple[tuple[float, float], ...]


def pair(rest: float, visit: float, low: float, high: float, width: float = 0.7) -> Truth:
    """Return a system of two configurations."""
    return Truth((rest, visit), width, ((0.0, 0.0), (low, high)))


CHAIN = Truth((3000.0, 3000.0, 3000.0), 0.4, ((0.0, 0.0), (0.4, 0.6), (0.8, 1.2)))


def record(systems: list[Truth], rng: np.random.Generator) -> tuple[Segments, IntArray]:
    """Return a record's stays with the noise of their means, and the configurations of the systems in each."""
    friction = np.zeros((len(systems), SLOTS))
    configuration = np.zeros((len(systems), SLOTS), dtype=np.int64)
    for i, system in enumerate(systems):
        slot, q, top = -int(rng.integers(20_000, 60_000)), 0, len(system.medians) - 1
        while slot < SLOTS:
            lasts = max(int(rng.lognormal(np.log(system.medians[q]), system.width)), 1)
            begin, end = max(slot, 0), min(max(slot + lasts, 0), SLOTS)
            friction[i, begin:end], configuration[i, begin:end] = rng.uniform(*system.friction[q]), q
            slot += lasts
            q += 1 if q == 0 else -1 if q == top else int(rng.choice([-1, 1]))
    first = np.concatenate([[0], np.flatnonzero(np.any(np.diff(configuration, axis=1), axis=0)) + 1])
    at = np.append(first, SLOTS)
    std = NOISE / np.sqrt(np.diff(at))
    level = 1.0 + friction[:, first].sum(axis=0) + rng.normal(0.0, std)
    return Segments(BASE * level, BASE * std, at), configuration[:, first].T


def parted(systems: list[Truth], seed: int, count: int = 8) -> JumpAttribution:
    """Part the jumps of some records of these systems."""
    rng = np.random.default_rng(seed)
    return attribute_jumps([record(systems, rng)[0] for _ in range(count)], BASE)


@pytest.mark.parametrize(
    "systems",
    [
        [pair(6000, 400, 0.4, 0.6)],
        [pair(6000, 400, 0.35, 0.35), pair(9000, 3000, 0.7, 0.7)],
        [pair(6000, 400, 0.3, 0.5), pair(9000, 3000, 0.6, 0.9)],
        [pair(5000, 400, 0.3, 0.6, 0.4), pair(7000, 3000, 0.4, 0.8, 0.4)],
        [pair(5000, 400, 0.5, 0.5), pair(8000, 3000, 0.515, 0.515)],
        [pair(4000, 100, 0.2, 0.25), pair(5000, 800, 0.4, 0.5), pair(9000, 4000, 0.8, 0.95)],
        [CHAIN],
        [pair(4000, 1000, 0.2, 0.28), CHAIN],
    ],
    ids=["one", "lap", "ranges", "ranges lap", "3 %", "three", "chain", "pair and chain"],
)
def test_systems_come_back_though_their_durations_overlap(systems: list[Truth]) -> None:
    found = parted(systems, 50_601)
    check_distinguished(found, BASE, HOURS)
    assert sorted(found.chains.counts) == sorted(len(system.medians) for system in systems)
    # Systems of as many configurations are compared in the order of their highest friction.
    order = sorted(range(len(systems)), key=lambda i: (found.chains.counts[i], found.chains.size[i].max()))
    true = sorted(systems, key=lambda system: (len(system.medians), sum(system.friction[-1])))
    for i, system in zip(order, true, strict=True):
        for q, (median, (low, high)) in enumerate(zip(system.medians, system.friction, strict=True)):
            seen = [visit for visit in found.visits[i] if visit.configuration == q]
            # Four standard errors of the mean of logarithms, beside which a sojourn that was cut adds little; of the
            # mean of a range, beside what a level is off by.
            assert abs(found.chains.mu[i, q] - np.log(median)) < 4.0 * (system.width / np.sqrt(len(seen)) + 0.02)
            error = (high - low) / np.sqrt(12 * len(seen)) + 0.002
            assert abs(found.chains.size[i, q] / BASE - 0.5 * (low + high)) < 4.0 * error


def test_systems_of_one_size_and_one_law_are_refused_without_asking_for_more() -> None:
    alike = [pair(5000, 1500, 0.4, 0.6)] * 2
    for seed in (50_610, 50_611):
        found = parted(alike, seed)
        assert found.chains.counts == (2, 2)
        with pytest.raises(InputError, match="More recordings would not help") as refused:
            check_distinguished(found, BASE, HOURS)
        assert "give about" not in str(refused.value)


def test_visits_that_durations_alone_tell_apart_are_hardly_confused() -> None:
    # Of one size; visits a factor of 40 apart, 9 standard deviations.
    found = parted([pair(9000, 100, 0.5, 0.5, 0.4), pair(9000, 4000, 0.5, 0.5, 0.4)], 50_620)
    assert found.chains.counts == (2, 2)
    assert confused_share(found.chains, found.visits, 0, 1) < 0.01


def test_many_visits_of_one_system_are_not_parted_in_halves() -> None:
    assert parted([pair(3000, 400, 0.3, 0.5)], 50_660, count=20).chains.counts == (2,)


def known(systems: list[Truth]) -> Chains:
    """Return systems as they truly are."""
    shape = len(systems), max(len(system.medians) for system in systems)
    size, spread, mu, sigma, up = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.ones(shape), np.zeros(shape)
    for i, system in enumerate(systems):
        count = len(system.medians)
        friction: FloatArray = BASE * np.array(system.friction)
        size[i, :count], spread[i, :count] = friction.mean(axis=1), np.diff(friction)[:, 0] / np.sqrt(12.0)
        mu[i, :count], sigma[i, :count] = np.log(system.medians), system.width
        up[i, :count] = [1.0, *[0.5] * (count - 2), 0.0]
    counts = tuple(len(system.medians) for system in systems)
    return Chains(counts, size, spread, mu, sigma, up, BASE, 0.01 * BASE)


@pytest.mark.parametrize("seed", range(50_630, 50_635))
def test_the_path_of_known_systems_is_found(seed: int) -> None:
    systems = [pair(4000, 1000, 0.2, 0.28), CHAIN]
    segments, true = record(systems, np.random.default_rng(seed))
    path = decode(segments, known(systems), 64)
    assert np.array_equal(path.configurations, true)
    assert not path.outlier.any()


def test_a_stay_at_no_system_s_level_is_an_outlier() -> None:
    systems = [pair(6000, 1000, 0.4, 0.6)]
    segments, true = record(systems, np.random.default_rng(50_640))
    at_rest = int(np.flatnonzero(true[1:-1, 0] == 0)[0]) + 1
    middle = (segments.at[at_rest] + segments.at[at_rest + 1]) // 2
    # A piece of ten slots, at a level far from any configuration, in the middle of a rest.
    level = np.insert(segments.level, at_rest + 1, [3.0 * BASE, segments.level[at_rest]])
    std = np.insert(segments.std, at_rest + 1, [BASE * NOISE / np.sqrt(10.0), segments.std[at_rest]])
    path = decode(Segments(level, std, np.insert(segments.at, at_rest + 1, [middle, middle + 10])), known(systems), 64)
    assert np.flatnonzero(path.outlier).tolist() == [at_rest + 1]
    assert path.configurations[[at_rest, at_rest + 2], 0].tolist() == [0, 0]


def test_the_beam_s_best_is_the_best_of_all_paths() -> None:
    # Wider beams find no better path in records of two systems.
    systems = [pair(6000, 400, 0.3, 0.5), pair(9000, 3000, 0.6, 0.9)]
    segments, _ = record(systems, np.random.default_rng(50_650))
    narrow, wide = (decode(segments, known(systems), beam).log_likelihood for beam in (64, 2000))
    assert narrow == pytest.approx(wide)
