"""Changepoint detectors of other packages, called as their documentation states; each package is optional.

They are given what they need and cannot estimate: friction less viscous friction of the true slope, over the noise's
standard deviation, so that the problem is a change of the mean in white noise of variance one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Final

import numpy as np

from rwa_monitor.paper.detection import SCALE
from rwa_monitor.samples import FloatArray

PENALTIES: Final = 2.0  # times BIC's 2 log n: about as few false changepoints as ours, almost none


class MissingPeerError(Exception):
    """A package to compare with is not installed; the message names it and how to install it."""


@dataclass(frozen=True, slots=True)
class Peer:
    """A changepoint detector of another package.

    Attributes
    ----------
    name
        Package and detector.
    search
        Finds the changepoints of a normalised series, float64 (n,).
    rounds
        Largest number of timed runs: some take seconds.
    """

    name: str
    search: Callable[[FloatArray], object]
    rounds: int = 15


def _package(name: str) -> ModuleType:
    try:
        return import_module(name)
    except ImportError as error:
        package = name.partition(".")[0].replace("_", "-")
        raise MissingPeerError(f"{package} is not installed (pip install {package}); it is left out") from error


def _penalty(series: FloatArray) -> float:
    return PENALTIES * 2.0 * float(np.log(series.size))


def skchange_fpop() -> Peer:
    """Return skchange's FPOP: exact optimal partitioning with functional pruning, compiled; the fastest peer known."""
    detectors = _package("skchange.detectors")
    return Peer(
        "skchange FPOP",
        lambda series: (
            detectors.FPOP(penalty=_penalty(series)).fit(series.reshape(-1, 1)).predict(series.reshape(-1, 1))
        ),
    )


def skchange_moving_window() -> Peer:
    """Return skchange's MovingWindow: the same principle as the wGLR, at one scale."""
    detectors, scorers = _package("skchange.detectors"), _package("skchange.interval_scorers")

    def search(series: FloatArray) -> object:
        detector = detectors.MovingWindow(scorers.CUSUM(), bandwidth=SCALE)
        return detector.fit(series.reshape(-1, 1)).predict(series.reshape(-1, 1))

    return Peer("skchange MovingWindow", search, rounds=5)


def ruptures_window() -> Peer:
    """Return ruptures' Window, with the paper's width."""
    ruptures = _package("ruptures")
    return Peer(
        "ruptures Window",
        lambda series: ruptures.Window(width=2 * SCALE, model="l2").fit(series).predict(pen=_penalty(series)),
        rounds=1,
    )


def ruptures_pelt() -> Peer:
    """Return ruptures' PELT for a change in mean, in its compiled form."""
    ruptures = _package("ruptures")
    return Peer(
        "ruptures PELT (KernelCPD)",
        lambda series: ruptures.KernelCPD(kernel="linear", min_size=2).fit(series).predict(pen=_penalty(series)),
        rounds=1,
    )


def river_page_hinkley() -> Peer:
    """Return river's Page-Hinkley test, sample by sample: the peer of the incremental step."""
    drift = _package("river.drift")

    def search(series: FloatArray) -> object:
        detector = drift.PageHinkley()
        found = []
        for k, value in enumerate(series.tolist()):
            detector.update(value)
            if detector.drift_detected:
                found.append(k)
        return found

    return Peer("river PageHinkley, sample by sample", search, rounds=3)


def river_adwin() -> Peer:
    """Return river's ADWIN, sample by sample."""
    drift = _package("river.drift")

    def search(series: FloatArray) -> object:
        detector = drift.ADWIN()
        found = []
        for k, value in enumerate(series.tolist()):
            detector.update(value)
            if detector.drift_detected:
                found.append(k)
        return found

    return Peer("river ADWIN, sample by sample", search, rounds=1)


def focus() -> Peer:
    """Return FOCuS of changepoint-online, sample by sample, restarted at each changepoint; pure Python."""
    online = _package("changepoint_online")

    def search(series: FloatArray) -> object:
        detector, found, threshold = online.Focus(online.Gaussian()), [], 0.5 * _penalty(series)
        for k, value in enumerate(series.tolist()):
            detector.update(value)
            if detector.statistic() >= threshold:  # a log likelihood ratio
                found.append(k)
                detector = online.Focus(online.Gaussian())
        return found

    return Peer("changepoint-online FOCuS, sample by sample", search, rounds=1)


PEERS: Final = (
    skchange_fpop,
    skchange_moving_window,
    ruptures_window,
    ruptures_pelt,
    river_page_hinkley,
    river_adwin,
    focus,
)


# Without it skchange runs uncompiled, a hundred times slower: it is then left out of the comparison of times.
COMPILED_BY: Final = {skchange_fpop: "numba", skchange_moving_window: "numba"}


def installed(report: Callable[[str], None]) -> list[Peer]:
    """Return the installed peers in their fastest form, FPOP first; report the missing ones."""
    found = []
    for peer in PEERS:
        try:
            if peer in COMPILED_BY:
                _package(COMPILED_BY[peer])
            found.append(peer())
        except MissingPeerError as missing:
            report(str(missing))
    return found
