"""Runs one labelled window through both methods and the oracles, and compares the changepoints with the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass

import numpy as np

from benchmarks.accuracy.oracle import features_of_truth, features_with_true_jumps, jumps_of_ideal_search
from rwa_monitor.diagnosis.features import Features
from rwa_monitor.diagnosis.training import LabelledFeatures
from rwa_monitor.discrepancy.diagnosis_gain import PLACED_WITHIN, false_changepoints
from rwa_monitor.errors import InputError
from rwa_monitor.messages import AttributedChangepoint, Method
from rwa_monitor.monitor.core import WindowDiagnosed, diagnose_samples
from rwa_monitor.samples import BoolArray, IntArray, Samples
from rwa_monitor.simulation.datasets import LabelledWindow
from rwa_monitor.simulation.record import Changepoints
from rwa_monitor.wheel.wheel import Wheel


@dataclass(frozen=True, slots=True)
class JumpScore:
    """How well changepoints were found in one window, or summed over many.

    Attributes
    ----------
    visible
        True jumps that can be seen.
    placed, attributed
        Those found within 5 samples, and of these the ones on the right switching system.
    false
        Reported changepoints with no true jump within 5 samples.
    rejected
        Candidates that the assignment rejected.
    hidden
        Visible jumps that no sample can locate: they lie in a gap without used samples, more than 5 before its end.
    """

    visible: int = 0
    placed: int = 0
    attributed: int = 0
    false: int = 0
    rejected: int = 0
    hidden: int = 0

    def __add__(self, other: JumpScore) -> JumpScore:
        """Sum two scores."""
        return JumpScore(*(one + another for one, another in zip(astuple(self), astuple(other), strict=True)))


@dataclass(frozen=True, slots=True)
class Outcome:
    """Results on one labelled window.

    Attributes
    ----------
    status
        nominal, or the active anomalies joined by "+".
    labels
        By anomaly: whether it is present.
    features
        By method (joint, paper) and oracle ("oracle A" is given the components, "oracle B" the jumps).
    jumps
        By method, and for "oracle C".
    """

    status: str
    labels: Mapping[str, bool]
    features: Mapping[str, Features]
    jumps: Mapping[str, JumpScore]

    def labelled(self, features: str = "joint") -> LabelledFeatures:
        """Return the features to train on, by the name of the method or oracle."""
        return LabelledFeatures(self.features[features], self.labels)


def evaluate(window: LabelledWindow, methods: tuple[Method, ...] = ("joint", "paper")) -> Outcome:
    """Run one labelled window through the methods and the oracles.

    Parameters
    ----------
    window
        The window.
    methods
        The methods to run; the paper's takes seconds for windows with many candidates.

    Raises
    ------
    InputError
        If the record is not exactly one window.
    """
    features: dict[str, Features] = {
        "oracle A": features_of_truth(window),
        "oracle B": features_with_true_jumps(window),
    }
    truth, wheel = window.telemetry.truth, window.wheel
    jumps = {"oracle C": score_jumps(jumps_of_ideal_search(window), truth.changepoints, wheel, truth.used)}
    for method in methods:
        closed = only_window(window.telemetry.samples, wheel, method, window.name)
        features[method] = closed.features
        jumps[method] = score_jumps(closed.diagnosis.changepoints, truth.changepoints, wheel, truth.used)
    return Outcome(window.status, window.labels, features, jumps)


def only_window(samples: Samples, wheel: Wheel, method: Method, source: str) -> WindowDiagnosed:
    """Diagnose a record of one window, without a model and without earlier windows.

    Raises
    ------
    InputError
        If the record is not exactly one window.
    """
    windows = list(diagnose_samples(samples, wheel, None, method=method))
    if len(windows) != 1:
        raise InputError(source, f"holds {len(windows)} windows where one is expected")
    return windows[0]


def score_jumps(
    found: Sequence[AttributedChangepoint], truth: Changepoints, wheel: Wheel, used: BoolArray | None = None
) -> JumpScore:
    """Match each visible true jump, in order, to the nearest reported changepoint not yet matched, and count.

    Parameters
    ----------
    found, truth
        Reported and true.
    wheel
        Its wheel.
    used
        bool (slots,), the slots with a usable sample; with None no jump counts as hidden.
    """
    names = [system.name for system in wheel.fss]
    accepted = [changepoint for changepoint in found if changepoint.fss != "rejected"]
    index = np.array([changepoint.index for changepoint in accepted], dtype=np.int64)
    placed = attributed = 0
    taken = np.zeros(index.size, dtype=np.bool_)
    for true_index, system in zip(truth.index[truth.visible], truth.system[truth.visible], strict=True):
        distance = np.where(taken, np.iinfo(np.int64).max, np.abs(index - true_index))
        if distance.size == 0 or int(distance.min()) > PLACED_WITHIN:
            continue
        nearest = int(np.argmin(distance))
        taken[nearest] = True
        placed += 1
        attributed += accepted[nearest].fss == names[int(system)]
    return JumpScore(
        visible=int(truth.visible.sum()),
        placed=placed,
        attributed=attributed,
        false=false_changepoints(found, truth),
        rejected=len(found) - len(accepted),
        hidden=0 if used is None else int(_hidden(truth.index[truth.visible], used).sum()),
    )


def _hidden(index: IntArray, used: BoolArray) -> BoolArray:
    """Return which jumps lie more than `PLACED_WITHIN` slots before the next used sample.

    All slots from the last used sample to the next one fit the samples equally well; the next one is reported.
    """
    slots = np.flatnonzero(used)
    return np.asarray(np.append(slots, used.size)[np.searchsorted(slots, index)] - index > PLACED_WITHIN)
