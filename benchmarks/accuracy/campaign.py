"""Runs many labelled windows through the monitor on several cores, in order, and times each stage."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from typing import TypeVar

import numpy as np

from benchmarks.accuracy.outcome import Outcome, evaluate
from benchmarks.window import window_of
from rwa_monitor.diagnosis.classification import classify
from rwa_monitor.diagnosis.features import features_of
from rwa_monitor.diagnosis.model import Model, models_for
from rwa_monitor.messages import Method
from rwa_monitor.paper import assignment as paper_assignment
from rwa_monitor.paper import classification, detection
from rwa_monitor.samples import FloatArray
from rwa_monitor.simulation.datasets import RECIPES, LabelledWindow, wheel_windows
from rwa_monitor.switching.assignment import assign
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.switching.components import split

STAGES = ("changepoints", "assignment", "classification")


Given = TypeVar("Given")
Found = TypeVar("Found")


@dataclass(frozen=True, slots=True)
class _Task:
    """The windows of one wheel; each process simulates its own, since they are too large to pass between processes."""

    recipe: str
    number: int
    seed: int
    count: int
    methods: tuple[Method, ...]

    def run(self) -> list[Outcome]:
        windows = islice(wheel_windows(self.recipe, self.number, self.seed), self.count)
        return [evaluate(window, self.methods) for window in windows]


def outcomes(
    recipe: str, count: int, seed: int, workers: int, methods: tuple[Method, ...] = ("joint", "paper")
) -> Iterator[Outcome]:
    """Generate labelled windows and run each through the methods and the oracles, in order.

    Parameters
    ----------
    recipe, count, seed
        See `datasets.generate`.
    workers
        Processes that simulate and evaluate; 0 works in this one. The result does not depend on it.
    methods
        See `evaluate`.
    """
    life = RECIPES[recipe].windows
    tasks = [
        _Task(recipe, number, seed, min(life, count - number * life), methods) for number in range(-(-count // life))
    ]
    yield from chain.from_iterable(in_processes(_Task.run, tasks, workers))


def in_processes(work: Callable[[Given], Found], tasks: Iterable[Given], workers: int) -> Iterator[Found]:
    """Do the work on all tasks in `workers` processes, in order; 0 works in this one."""
    if workers == 0:
        yield from map(work, tasks)
        return
    # Spawned, not forked: a fork would inherit whatever threads and sessions the caller has.
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        yield from pool.imap(work, tasks, chunksize=1)


@dataclass(frozen=True, slots=True)
class StageTimes:
    """Wall time of each stage and in total, by window [s]; float64 (windows,) each."""

    method: Method
    seconds: dict[str, FloatArray]


def time_stages(windows: Sequence[LabelledWindow], model: Model, method: Method) -> StageTimes:
    """Time the stages on given windows, one after the other in this process.

    The first window is run once beforehand, untimed, so that loading at first use does not count.
    """
    rows = [_time_window(window, model, method) for window in (windows[0], *windows)][1:]
    seconds = {stage: np.array([row[k] for row in rows]) for k, stage in enumerate(STAGES)}
    seconds["all"] = np.array([sum(row) for row in rows])
    return StageTimes(method, seconds)


def _time_window(window: LabelledWindow, model: Model, method: Method) -> tuple[float, float, float]:
    return _time_paper(window, model) if method == "paper" else _time_joint(window, model)


def _time_joint(window: LabelledWindow, model: Model) -> tuple[float, float, float]:
    wheel, empty, on_slots = window.wheel, CarriedState.empty(), window_of(window)
    models, names = models_for(wheel, model), wheel.anomalies
    begin = time.thread_time()
    evidence = on_slots.evidence()
    detected = time.thread_time()
    assignment, estimate = assign(evidence, wheel, empty)
    components = split(assignment, estimate, evidence, wheel, empty)
    assigned = time.thread_time()
    classify(features_of(components, assignment, wheel), models, names, model, empty)
    return detected - begin, assigned - detected, time.thread_time() - assigned


def _time_paper(window: LabelledWindow, model: Model) -> tuple[float, float, float]:
    """Time the paper's method, given the samples and the estimate of their noise."""
    wheel, evidence = window.wheel, window_of(window).evidence()
    models, names, signal = models_for(wheel, model), wheel.anomalies, detection.Signal.of(evidence)
    begin = time.thread_time()
    index = detection.detect(signal, evidence.noise, wheel)
    detected = time.thread_time()
    assignment, levels = paper_assignment.assign(signal, index, evidence.noise, wheel)
    components = paper_assignment.split(assignment, levels, wheel)
    assigned = time.thread_time()
    classification.classify(features_of(components, assignment, wheel), models, names)
    return detected - begin, assigned - detected, time.thread_time() - assigned
