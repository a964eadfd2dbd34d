"""Disordered, broken telemetry gives the same, byte for byte, in whatever messages it comes, and over any restart.

A message that is clean and goes straight on takes a shorter way through the core than a spoiled one. So most of the
telemetry here is clean, and what is spoiled stands in places: with other cuts, other samples take the shorter way.
"""

from dataclasses import replace
from functools import cache

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import example, given, settings

from rwa_monitor.monitor.core import Event, WheelCore
from rwa_monitor.monitor.ingest import Trouble
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.wheel import Wheel
from tests.monitor.support import WINDOW, messages_of, model, pieces, resumed, telemetry, wheel

ROWS = 3_600
PLACES = 24  # stretches in which something is wrong
BORDERS = (WINDOW - 40, WINDOW - 3, WINDOW + 5, 2 * WINDOW - 15, 2 * WINDOW - 2)  # others, about the ends of windows


def disordered(samples: Samples, seed: int) -> Samples:
    """Return telemetry that is spoiled in some places, each in one way."""
    rng = np.random.default_rng(seed)
    time_ns, speed = samples.time_ns.copy(), samples.speed_rad_s.copy()
    name = "motor_current_A" if samples.friction_torque_Nm is None else "friction_torque_Nm"
    torque = dict(samples.channels())[name].copy()
    order = np.arange(time_ns.size)
    keep = np.ones(time_ns.size, dtype=np.bool_)
    for start in np.sort([*rng.integers(10, ROWS - 200, PLACES), *BORDERS]).tolist():
        there = slice(start, start + int(rng.integers(2, 40)))
        single = int(rng.integers(there.start, there.stop))
        kind = int(rng.integers(12))
        if kind == 0:  # samples overtake each other
            order[there] = rng.permutation(order[there])
        elif kind == 1:  # samples come twice
            order[there.start + 1 : there.stop] = order[there.start : there.stop - 1]
        elif kind == 2:  # a gap
            keep[there] = False
        elif kind == 3:  # values that were not measured
            speed[there][rng.random(speed[there].size) < 0.5] = np.nan
        elif kind == 4:
            torque[single] = rng.choice([np.nan, np.inf, -np.inf])
        elif kind == 5:  # a broken word: beyond all limits, or only more than a wheel can do
            torque[single] *= rng.choice([1e12, 30.0])
        elif kind == 6:
            speed[single] += rng.choice([1e9, 40.0])
        elif kind == 7:  # a sensor hangs
            torque[there.start : there.start + 60] = torque[there.start]
        elif kind == 8:
            speed[there.start : there.start + 60] = rng.choice([0.0, speed[there.start]])
        elif kind == 9:  # a wild time
            time_ns[single] += int(rng.choice([-1, 1])) * 10**15
        elif kind == 10:  # jitter, some of it more than half a slot
            time_ns[there] += rng.integers(-70_000_000, 70_000_000, time_ns[there].size)
        else:  # the clock steps, and a new epoch begins
            time_ns[there.stop :] += 2 * WINDOW * 125_000_000
    order = order[keep[order]]
    temperature = np.array(samples.bearing_temperature_degC)
    temperature[rng.random(temperature.size) < 0.01] = np.nan
    temperature[WINDOW // 2 : WINDOW // 2 + 200] = np.nan
    temperature[2 * WINDOW :] = temperature[2 * WINDOW]  # it hangs
    changed = {"time_ns": time_ns, "speed_rad_s": speed, name: torque, "bearing_temperature_degC": temperature}
    return replace(samples, **changed)[order]


# hop, effects, friction given, and whether viscous friction follows the temperature: all ways in which a core works.
KINDS = {
    "given": (None, False, True, False),
    "derived": (None, False, False, False),
    "overlapping windows": (300, False, True, False),
    "windows with gaps between": (1_500, False, False, False),
    "effects, given": (None, True, True, False),
    "effects, derived, overlapping": (700, True, False, False),
    "heat, given": (None, False, True, True),
    "heat, effects, derived, overlapping": (700, True, False, True),
}
SEEDS = range(50_100, 50_108)


@cache
def case(kind: str, seed: int) -> tuple[Wheel, Samples, list[Event], object]:
    """Return wheel, telemetry, and the events and counts of a core that gets it at once."""
    hop, effects, given_, heat = KINDS[kind]
    of_wheel, samples = wheel(WINDOW, hop, effects, heat), disordered(telemetry(ROWS, 11, given_), seed)
    core = WheelCore(of_wheel, model())
    return of_wheel, samples, [*core.feed(samples), *core.finish()], core.counts


@pytest.mark.parametrize("kind", KINDS)
def test_all_that_is_interesting_happens(kind: str) -> None:
    seen = set()
    for seed in SEEDS:
        _, _, events, _ = case(kind, seed)
        seen |= {key.rsplit("/", 1)[1] for key, _ in messages_of(events)}
        seen |= {event.kind.rpartition(" ")[2] for event in events if isinstance(event, Trouble)}
    # "hangs", "it" (stands out from the samples around it), "step" of the clock, "samples" with a wild time
    assert {"diagnosis", "changepoints", "health", "carried", "hangs", "it", "step", "samples"} <= seen


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=15, deadline=None)
@given(
    seed=st.sampled_from(SEEDS),
    cuts=st.lists(st.integers(0, ROWS), max_size=40),
    restarts=st.sets(st.integers(0, 40), max_size=4),
)
@example(seed=50_100, cuts=list(range(ROWS)), restarts=set())  # each sample in a message of its own
@example(seed=50_230, cuts=[3_019], restarts=set())  # derived friction that stands out at the end of a block
def test_disordered_telemetry_gives_the_same_in_any_messages(
    kind: str, seed: int, cuts: list[int], restarts: set[int]
) -> None:
    of_wheel, samples, at_once, counts = case(kind, seed)
    core, events = WheelCore(of_wheel, model()), []
    for number, part in enumerate(pieces(samples, [min(cut, len(samples)) for cut in cuts])):
        if number in restarts:
            data = core.checkpoint()
            core = resumed(data, of_wheel)
            assert core.checkpoint() == data
        events += core.feed(part, "p", number)
    assert messages_of([*events, *core.finish()]) == messages_of(at_once)
    assert core.counts == counts
