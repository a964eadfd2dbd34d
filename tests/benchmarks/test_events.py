"""Event-wise scores in the benchmark: windows of a wheel in a row are one timeline, beside two dummies."""

import numpy as np

from benchmarks.accuracy.events import event_table


def test_windows_in_a_row_are_one_event_of_their_wheel() -> None:
    # Two wheels of three windows: an event from the second window on, found in the last; a false alarm on the other.
    truth = np.array([[0, 0], [1, 0], [1, 0], [0, 0], [0, 0], [0, 0]], dtype=np.bool_)
    diagnosed = np.array([[0, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0]], dtype=np.bool_)
    header, _, *rows = event_table(
        diagnosed, truth, ("dry", "viscous"), ("events", "false_alarms", "precision", "recall", "timing"), windows=3
    ).splitlines()
    assert header == "| anomaly | events | false alarms | precision | recall | timing |"
    assert rows == [
        "| dry | 1 | 0 | 1.000 | 1.000 | 0.500 |",
        "| viscous | 0 | 1 | 0.000 | – | – |",
        "| any | 1 | 1 | 0.375 | 1.000 | 0.500 |",
        "| any: dummy that always alarms | 1 | 1 | 0.000 | 1.000 | 0.152 |",
        "| any: dummy that never alarms | 1 | 0 | 0.000 | 0.000 | – |",
    ]
