"""Times whole windows of recipe `paper` one after the other: ours, the plain paper method and the fastest peer."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from benchmarks.speed.detection import NOMINAL_SLOPE, ONE_SCALE, seven_scales
from benchmarks.speed.peers import Peer
from benchmarks.window import Window, window_of
from rwa_monitor.changepoints.evidence import WindowAccumulator
from rwa_monitor.diagnosis.model import Model
from rwa_monitor.diagnosis.window import diagnose_window
from rwa_monitor.kernels.wglr import wglr
from rwa_monitor.paper import method as paper
from rwa_monitor.paper.detection import WEIGHT, Signal
from rwa_monitor.paper.detection import wglr as plain_wglr
from rwa_monitor.samples import FloatArray
from rwa_monitor.simulation.datasets import LabelledWindow
from rwa_monitor.switching.assignment import assign
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.durations import Uniform
from rwa_monitor.wheel.wheel import FrictionRange, SwitchingSystem, Wheel

REPEATS: Final = 3  # of each window; the least counts, since other load on the machine only adds time
PLAIN_EVERY: Final = 5  # every fifth window is also diagnosed by the plain method, which takes most of the time


@dataclass(frozen=True, slots=True)
class WindowTimes:
    """Times of each window [s], float64 (windows,); the last three for every `PLAIN_EVERY`-th window, else NaN.

    Attributes
    ----------
    gather
        Stage 1 while the samples come in.
    close
        From the window's last sample to its diagnosis: close, estimation, assignment, classification.
    kernel
        The seven-scale wGLR alone, over the whole window at once.
    plain, compiled
        The paper's method in plain numpy and Python, from the samples and the estimate of their noise; and the same
        with the time of its wGLR in numpy replaced by that of our kernel.
    fastest_peer
        Changepoints alone by the fastest peer; NaN throughout where it is not installed.
    """

    gather: FloatArray
    close: FloatArray
    kernel: FloatArray
    plain: FloatArray
    compiled: FloatArray
    fastest_peer: FloatArray

    @property
    def whole(self) -> FloatArray:
        """Ours, all stages."""
        return self.gather + self.close


def time_windows(
    windows: Iterable[LabelledWindow], model: Model, peer: Peer | None, repeats: int = REPEATS
) -> WindowTimes:
    """Time windows one after the other; the first is run once beforehand, untimed."""
    rows: list[list[float]] = []
    for number, labelled in enumerate(windows):
        window = window_of(labelled)
        if number == 0:
            _time_window(window, model, peer, 1, with_plain=True)
        rows.append(_time_window(window, model, peer, repeats, with_plain=number % PLAIN_EVERY == 0))
    return WindowTimes(*np.array(rows).T)


def _time_window(window: Window, model: Model, peer: Peer | None, repeats: int, *, with_plain: bool) -> list[float]:
    """Return gather, close, kernel, plain, compiled, peer."""
    series, kernel = window.series(), seven_scales(window)
    signal = Signal(window.x, window.z, window.good)
    numpy_wglr = partial(plain_wglr, signal, NOMINAL_SLOPE)
    one_scale = partial(wglr, *signal, ONE_SCALE, WEIGHT, NOMINAL_SLOPE)
    least = np.full(6, np.inf)
    for _ in range(repeats):
        accumulator = WindowAccumulator(window.wheel, slots=window.speed_rad_s.size)
        begin = time.thread_time()
        accumulator.append(window.speed_rad_s, window.torque_Nm, window.good)
        full = time.thread_time()
        evidence = accumulator.close()
        diagnose_window(evidence, window.wheel, model, CarriedState.empty())
        laps = [full - begin, time.thread_time() - full, _once(kernel), np.nan, np.nan, np.nan]
        if with_plain:
            laps[3] = _once(partial(paper.diagnose_window, evidence, window.wheel, model, CarriedState.empty()))
            laps[4] = laps[3] - _once(numpy_wglr) + _once(one_scale)
            if peer is not None:
                laps[5] = _once(lambda: peer.search(series))
        least = np.minimum(least, laps)
    return [float(value) for value in least]


def _once(run: Callable[[], object]) -> float:
    begin = time.thread_time()
    run()
    return time.thread_time() - begin


# ---- a window made to be hard ----------------------------------------------------------------------------------------

HARD_SYSTEMS: Final = 3
HARD_JUMPS: Final = 200
NOISE_STD: Final = 0.024  # the paper's, normalised
JUMP_SIZES: Final = (0.2, 0.8)  # normalised: any system may have made any of them


@dataclass(frozen=True, slots=True)
class HardWindow:
    """Cost of a window of many jumps, each of which any of several systems may have made.

    Attributes
    ----------
    candidates, systems
        Their numbers.
    seconds
        From its last sample to its diagnosis [s].
    states
        Partial assignments that the search expanded.
    pruned
        Whether the search reports that it discarded some.
    """

    candidates: int
    systems: int
    seconds: float
    states: int
    pruned: bool


def time_hard_window(wheel: Wheel, model: Model, seed: int, repeats: int = REPEATS) -> HardWindow:
    """Time a window with 200 jumps and three switching systems with the same broad laws; the first run is untimed."""
    window = hard_window(wheel, np.random.default_rng(seed))
    seconds: list[float] = []
    while True:
        accumulator = WindowAccumulator(window.wheel, slots=window.speed_rad_s.size)
        accumulator.append(window.speed_rad_s, window.torque_Nm, window.good)
        begin = time.thread_time()
        evidence = accumulator.close()
        diagnose_window(evidence, window.wheel, model, CarriedState.empty())
        seconds.append(time.thread_time() - begin)
        if len(seconds) > repeats:
            break
    assignment, _ = assign(evidence, window.wheel)
    return HardWindow(
        candidates=len(evidence.candidates),
        systems=len(window.wheel.fss),
        seconds=min(seconds[1:]),
        states=assignment.states,
        pruned=assignment.pruned,
    )


def hard_window(wheel: Wheel, rng: np.random.Generator, jumps: int = HARD_JUMPS, systems: int = HARD_SYSTEMS) -> Window:
    """Make a window in which only the number of jumps distinguishes the switching systems.

    Parameters
    ----------
    wheel
        The wheel, whose switching systems are replaced.
    rng
        Source of the places, sizes and systems of the jumps.
    jumps, systems
        Their numbers.
    """
    slots = wheel.window.samples
    law = Uniform(low=1, high=slots // 2)
    friction = (FrictionRange(low=0.0, high=0.0), FrictionRange(low=0.2, high=0.8), FrictionRange(low=0.4, high=1.6))
    alike = [SwitchingSystem(name=f"fss_{s + 1}", durations=(law, law, law), friction=friction) for s in range(systems)]
    hard = wheel.model_copy(update={"fss": tuple(alike)})
    index = np.sort(rng.choice(np.arange(1, slots), jumps, replace=False))
    configuration, step = np.zeros(systems, dtype=np.int64), np.zeros(jumps)
    for k in range(jumps):
        s = int(rng.integers(systems))
        direction = {0: 1, 1: int(rng.choice((-1, 1))), 2: -1}[int(configuration[s])]
        configuration[s] += direction
        step[k] = direction * rng.uniform(*JUMP_SIZES)
    change = np.zeros(slots)
    change[index] = step
    x = 0.5 + 0.3 * np.sin(np.arange(slots) / 9000.0)
    z = 1.0 + np.cumsum(change) + x + NOISE_STD * rng.standard_normal(slots)
    speed, torque = x * wheel.speed_unit_rad_s, z * wheel.torque_unit_Nm
    return Window(hard, speed, torque, np.ones(slots, dtype=np.bool_), NOISE_STD, 1.0)
