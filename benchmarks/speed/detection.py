"""Changepoint detection on one window of 80,000 samples: our kernels, a lower limit of their time, and peers."""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.speed.peers import Peer
from benchmarks.speed.race import Lap, Runner, laps
from benchmarks.window import Window
from rwa_monitor.kernels.evidence import KEPT_STATISTIC
from rwa_monitor.kernels.wglr import Detector, wglr
from rwa_monitor.paper.detection import SCALE, WEIGHT, Signal, detect
from rwa_monitor.paper.detection import wglr as plain_wglr
from rwa_monitor.samples import FloatArray

SEVEN_SCALES: Final = (2, 4, 8, 16, 32, 64, 128)
ONE_SCALE: Final = SCALE
NOMINAL_SLOPE: Final = 1.0  # normalised
LIMIT: Final = "five sequential running sums, compiled (the limit)"
OURS_ONE: Final = f"ours, one scale w = {ONE_SCALE}"
OURS_SEVEN: Final = "ours, seven scales 2 … 128"
OURS_STAGE: Final = "ours, the whole of stage 1 (eight scales, sums, noise, peaks, slope, candidates)"
PLAIN: Final = f"plain numpy wGLR, one scale w = {ONE_SCALE}"


def detection_laps(window: Window, peers: list[Peer]) -> list[Lap]:
    """Time all detectors in turns.

    Parameters
    ----------
    window
        A window without bad slots, as recipe `paper` gives it.
    peers
        The installed peers.
    """
    x, z, used, series = window.x, window.z, window.good, window.series()
    sums, plain = five_sums(x, z), Signal(x, z, used)

    runners = [
        Runner(LIMIT, "limit", sums),
        Runner("five running sums, numpy cumsum", "limit", lambda: [np.cumsum(v) for v in (x, z, x * x, x * z, z * z)]),
        Runner(OURS_ONE, "ours", lambda: wglr(x, z, used, ONE_SCALE, WEIGHT, NOMINAL_SLOPE)),
        Runner(OURS_SEVEN, "ours", seven_scales(window)),
        Runner(OURS_STAGE, "ours", window.evidence),
        Runner(PLAIN, "peer", lambda: plain_wglr(plain, NOMINAL_SLOPE)),
        Runner("plain numpy, with changepoints", "peer", lambda: detect(plain, window.noise, window.wheel)),
        *(Runner(peer.name, "peer", _bound(peer, series), peer.rounds) for peer in peers),
    ]
    return laps(runners)


def five_sums(x: FloatArray, z: FloatArray) -> Callable[[], object]:
    """Return a function that computes the five running sums of x and z, compiled with the kernels' flags."""
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "five_sums.so"
        flags = ("-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared")
        subprocess.run(["cc", *flags, "-o", library, Path(__file__).with_name("five_sums.c")], check=True)
        compiled = ctypes.CDLL(str(library)).five_sums
    out = np.empty((5, x.size))

    def run() -> object:
        return compiled(*(ctypes.c_void_p(values.ctypes.data) for values in (x, z, out)), ctypes.c_long(x.size))

    return run


def _bound(peer: Peer, series: FloatArray) -> Callable[[], object]:
    return lambda: peer.search(series)


def seven_scales(window: Window) -> Callable[[], object]:
    """Return the kernel of the live detection over the whole window: statistic, histogram and peaks of seven scales."""
    scales = np.array(SEVEN_SCALES, dtype=np.int64)
    variances = np.full(scales.size, window.noise_std**2)
    floors = KEPT_STATISTIC * variances
    settings = (WEIGHT, NOMINAL_SLOPE, variances, floors, floors)
    x, z, used = window.x, window.z, window.good

    def run() -> object:
        """Scan the whole window from the start."""
        detector = Detector(scales)
        detector.scan(x, z, used, 0, x.size, True, settings)
        return detector

    return run
