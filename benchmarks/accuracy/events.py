"""Event-wise scores of diagnosed windows, as `rwa-monitor evaluate` gives them, with the two dummy detectors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from benchmarks.page import NONE, table
from rwa_monitor.samples import BoolArray
from rwa_monitor.telemetry.scores import Timeline, score

COLUMNS: Final = {
    "events": "events",
    "false_alarms": "false alarms",
    "precision": "precision",
    "recall": "recall",
    "f_0_5": "F0.5",
    "alarming_precision": "alarming precision",
    "timing": "timing",
    "affiliation_precision": "affiliation precision",
    "affiliation_recall": "affiliation recall",
    "affiliation_f_0_5": "affiliation F0.5",
}


def event_table(
    diagnosed: BoolArray, truth: BoolArray, anomalies: Sequence[str], columns: Sequence[str], windows: int = 1
) -> str:
    """Return a table with the scores of each anomaly and of "any anomaly", and of the dummy detectors on the latter.

    Parameters
    ----------
    diagnosed, truth
        bool (wheels · windows, anomalies), the windows of a wheel one after the other.
    anomalies
        Their names.
    columns
        Which of `COLUMNS`.
    windows
        Number of windows of each wheel. They form a timeline; consecutive windows with an anomaly are one event.
    """
    together = list(_timelines(np.logical_or.reduce(diagnosed, axis=1), np.logical_or.reduce(truth, axis=1), windows))
    scores = {name: score(_timelines(diagnosed[:, a], truth[:, a], windows)) for a, name in enumerate(anomalies)} | {
        "any": score(together),
        "any: dummy that always alarms": score(one.always for one in together),
        "any: dummy that never alarms": score(one.never for one in together),
    }
    rows = [[name, *(_cell(getattr(one, column)) for column in columns)] for name, one in scores.items()]
    return table(["anomaly", *(COLUMNS[column] for column in columns)], rows)


def _timelines(diagnosed: BoolArray, truth: BoolArray, windows: int) -> Iterator[Timeline]:
    for alarms, events in zip(diagnosed.reshape(-1, windows), truth.reshape(-1, windows), strict=True):
        yield Timeline(0, windows, _runs(events), _runs(alarms))


def _runs(there: BoolArray) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(there.astype(np.int8), prepend=0, append=0)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def _cell(value: int | float | None) -> str:
    return NONE if value is None else str(value) if isinstance(value, int) else f"{value:.3f}"
