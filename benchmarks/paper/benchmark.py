"""Runs all measurements of the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from benchmarks.accuracy.benchmark import Benchmark, RecipeResult, summarise, targets
from benchmarks.accuracy.campaign import StageTimes, in_processes, time_stages
from benchmarks.accuracy.splits import Accuracy, measure
from benchmarks.paper.bins import BinsSweep, sweep
from benchmarks.paper.examine import ERROR_STEP, HARD, ORACLE, Examined, examine
from benchmarks.paper.peers import FPOP, Detected, SecondSource, add_second_source, compare
from benchmarks.paper.run_length import RunLengths, run_lengths
from benchmarks.paper.widths import Width, sweep_widths, try_widths
from benchmarks.speed.peers import (
    MissingPeerError,
    Peer,
    ruptures_pelt,
    ruptures_window,
    skchange_fpop,
    skchange_moving_window,
)
from benchmarks.target import Target, at_most
from rwa_monitor.cli.options import track
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.messages import Method
from rwa_monitor.samples import IntArray
from rwa_monitor.simulation.datasets import generate
from rwa_monitor.wheel.wheel import built_in_wheel

SPLITS: Final = 30  # random splits, as in the paper
RECIPE: Final = "paper"
HARD_RECIPE: Final = "hard"  # on which changepoints are compared as well
METHODS: Final[tuple[Method, ...]] = ("paper", "joint")
PAPER_EXCESS_RMSE: Final = 0.0025  # with changepoints, normalised
PAPER_ERROR: Final = 0.08  # up to which the paper's errors follow the Gaussian, normalised
MORE_BEYOND: Final = 1.05  # largest ratio of samples beyond it to those with the true changepoints
ENOUGH: Final = 100  # windows, below which rates are too uncertain to call a target missed
PEERS: Final = (skchange_fpop, skchange_moving_window, ruptures_window, ruptures_pelt)
QUICK_PEERS: Final = (skchange_fpop, skchange_moving_window)


@dataclass(frozen=True, slots=True)
class Size:
    """Extent of the measurement.

    Attributes
    ----------
    windows, seed
        Windows of the recipe `paper`.
    splits
        Random splits of the paper's protocol.
    swept
        Windows of the sweep over the half-width of the paper's detector; 0: no sweep.
    timed
        Windows whose stages are timed and whose changepoints are compared with other packages'.
    peers
        The packages to compare with.
    """

    windows: int = 1000
    seed: int = 17_181
    splits: int = SPLITS
    swept: int = 300
    timed: int = 20
    peers: tuple[Callable[[], Peer], ...] = PEERS

    def quick(self) -> Size:
        """Return a small version, for a quick look and for tests."""
        return replace(self, windows=40, splits=3, swept=0, timed=1, peers=QUICK_PEERS)


@dataclass(frozen=True, slots=True)
class PaperBenchmark:
    """All results of the page.

    Attributes
    ----------
    size
        Extent of the measurement.
    result
        Accuracy, jumps and rejections of both methods and the oracles.
    hard
        Accuracy of the paper's method with hard duration laws, as printed.
    examined
        One entry per window.
    bins
        The sweep of the number of bins.
    widths
        The sweep of the half-width of the paper's detector.
    run_lengths
        Average run lengths.
    detected
        By recipe: changepoints of ours and of other packages.
    second_source
        By recipe: the benefit of FPOP's candidates in addition to ours; empty without skchange.
    times
        Time of each stage, by method.
    missing
        Packages that could not be compared, and why.
    """

    size: Size
    result: RecipeResult
    hard: Accuracy
    examined: tuple[Examined, ...]
    bins: BinsSweep
    widths: tuple[Width, ...]
    run_lengths: RunLengths
    detected: Mapping[str, tuple[Detected, ...]]
    second_source: Mapping[str, SecondSource]
    times: tuple[StageTimes, ...]
    missing: tuple[str, ...]

    def excess_rmse(self, who: str) -> float:
        """Return the mean excess RMSE of a method or the oracle, normalised."""
        return float(np.mean([one.fitted[who].excess_rmse for one in self.examined]))

    def beyond(self, who: str, error: float = PAPER_ERROR) -> float:
        """Return the share of samples whose absolute error exceeds `error`, a multiple of `ERROR_STEP`."""
        counts = self.errors(who)
        return float(counts[round(error / ERROR_STEP) :].sum() / counts.sum())

    def errors(self, who: str) -> IntArray:
        """Return the histogram of all absolute errors of a method or the oracle, see `Fitted.errors`."""
        errors: IntArray = np.sum([one.fitted[who].errors for one in self.examined], axis=0)
        return errors

    @property
    def enough(self) -> bool:
        """Whether there are enough windows to call a target missed."""
        return self.size.windows >= ENOUGH


def run(size: Size, workers: int = 2) -> PaperBenchmark:
    """Measure everything.

    Parameters
    ----------
    size
        Extent of the measurement.
    workers
        Processes that examine windows; 0 works in this one. Only times depend on it.
    """
    examined = tuple(
        track(in_processes(examine, generate(RECIPE, size.windows, size.seed), workers), size.windows, "windows")
    )
    outcomes = [one.outcome for one in examined]
    swept = min(size.swept, size.windows)
    widths = list(track(in_processes(try_widths, generate(RECIPE, swept, size.seed), workers), swept, "half-widths"))
    wheel = built_in_wheel()  # all wheels of the recipe have its systems
    peers, missing = _installed(size.peers)
    compared = {recipe: list(generate(recipe, size.timed, size.seed)) for recipe in (RECIPE, HARD_RECIPE)}
    model = built_in_model()
    return PaperBenchmark(
        size=size,
        result=summarise(RECIPE, outcomes, size.seed, size.splits),
        hard=measure(outcomes, HARD, "paper", wheel, size.seed, size.splits),
        examined=examined,
        bins=sweep(outcomes, "paper", size.seed, size.splits),
        widths=sweep_widths(outcomes[:swept], widths, size.seed, size.splits) if swept else (),
        run_lengths=run_lengths(size.seed),
        detected={recipe: tuple(compare(windows, peers)) for recipe, windows in compared.items()},
        second_source={recipe: add_second_source(windows, peers[0]) for recipe, windows in compared.items()}
        if peers and peers[0].name == FPOP
        else {},
        times=tuple(time_stages(compared[RECIPE], model, method) for method in METHODS),
        missing=missing,
    )


def _installed(wanted: Sequence[Callable[[], Peer]]) -> tuple[list[Peer], tuple[str, ...]]:
    found, missing = [], []
    for peer in wanted:
        try:
            found.append(peer())
        except MissingPeerError as error:
            missing.append(str(error))
    return found, tuple(dict.fromkeys(missing))


def paper_targets(found: PaperBenchmark) -> list[Target]:
    """Return the targets of the method `joint` relative to the paper and the oracle, with the figures reached."""
    name = f"samples with an error beyond {PAPER_ERROR}, over those of the oracle"
    return [
        *targets(Benchmark((found.result,), found.times)),
        at_most("mean excess RMSE with changepoints", found.excess_rmse("joint"), PAPER_EXCESS_RMSE),
        at_most(name, found.beyond("joint") / found.beyond(ORACLE), MORE_BEYOND),
    ]
