"""Drag that decays with the angle turned since a reversal is named, and is no set of names that fit together."""

import numpy as np
import pytest

from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.plan import plan
from tests.discrepancy.simple import PERIOD_S, WHEEL, Array, record

COUNT = 8000


def runs(seed: int) -> Array:
    """Return runs of a few minutes in one direction and then the other, at speeds that differ and wander [rad/s]."""
    rng = np.random.default_rng(seed)
    ends = np.cumsum(rng.integers(500, 1100, 16))
    speeds = rng.uniform(60.0, 220.0, ends.size) * np.where(np.arange(ends.size) % 2, -1.0, 1.0)
    at = np.stack([ends - 150, ends], axis=1).ravel()
    motion = np.interp(np.arange(COUNT), at, np.stack([np.append(90.0, speeds[:-1]), speeds], axis=1).ravel())
    return np.asarray(motion * (1.0 + 0.1 * np.sin(2 * np.pi * np.arange(COUNT) * PERIOD_S / 37.0)))


@pytest.mark.parametrize(("seed", "turns", "viscous"), [(50400, 300.0, False), (50401, 150.0, True)])
def test_grease_that_channels_after_each_reversal_is_reported_with_the_turns_it_takes(
    seed: int, turns: float, viscous: bool
) -> None:
    def churning(speed: Array, _: Array) -> Array:
        left, drag = 0.0, np.empty(speed.size)
        for k, now in enumerate(speed):
            if k and now * speed[k - 1] < 0:
                left = 1.0
            left *= np.exp(-abs(now) * PERIOD_S / (2 * np.pi * turns))
            drag[k] = 3e-4 * left * (now / 100.0 if viscous else np.sign(now))
        return drag

    found = find_discrepancy([("grease", record(runs(seed), effect=churning, seed=seed)[0])], WHEEL)
    assert not found.result.effects
    words = found.result.unexplained.signature
    assert "decays with the angle turned since each reversal" in words
    assert float(words.split("over about ")[1].split(" turns")[0]) == pytest.approx(turns, rel=0.15)
    assert any("does it decay with turns or with time?" in line for line in plan(found).advice)


def test_reversals_without_grease_show_nothing() -> None:
    found = find_discrepancy([("plain", record(runs(50402), seed=50402)[0])], WHEEL)
    assert found.result.verdict == "adequate"
