"""A wheel beside its siblings: what all share is one alarm of the spacecraft, what one has alone comes sooner."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from rwa_monitor.history.alarms import ALL_WHEELS, OWN_ADVICE, Shift, compare, shift_of
from rwa_monitor.history.database import AlarmRecord
from rwa_monitor.history.store import History
from rwa_monitor.messages import Diagnosis
from tests.history.support import diagnosis

WHEELS = ("wheel_1", "wheel_2", "wheel_3", "wheel_4")


def moved_a_little(window: Diagnosis, factor: float) -> Diagnosis:
    """The same window, nominal, with another viscous friction."""
    viscous = window.anomalies["viscous"]
    moved = viscous.model_copy(update={"estimate": factor * (viscous.estimate or 0.0)})
    return window.model_copy(update={"anomalies": {"viscous": moved}})


def test_evidence_is_that_of_the_joint_gaussians() -> None:
    """The weights by a dense covariance of five hypotheses for three wheels, independent of the module's own loop."""
    from scipy.stats import multivariate_normal

    r, own = np.array([0.05, 0.04, 0.11]), np.diag([1e-4, 2e-4, 1e-4])
    found = compare([Shift(value, variance, 0.05) for value, variance in zip(r, np.diag(own), strict=True)])
    assert found is not None
    weights = np.zeros((2, 4))
    for shared in (0, 1):
        for alone in range(4):  # 3: none of them
            covariance = own + 0.04 * (shared * np.ones((3, 3)) + (np.diag(np.eye(4)[alone, :3])))
            prior = (0.05 if shared else 0.95) * (0.02 if alone < 3 else 0.94)
            weights[shared, alone] = prior * multivariate_normal(np.zeros(3), covariance).pdf(r)
    weights /= weights.sum()
    assert found.common == pytest.approx(weights[1].sum(), rel=1e-9)
    assert found.alone == pytest.approx(weights[:, :3].sum(axis=0), rel=1e-9)


def test_two_wheels_are_not_compared() -> None:
    assert compare([Shift(0.1, 1e-4, 0.05)] * 2) is None


def test_anomalous_windows_do_not_become_what_a_wheel_was() -> None:
    values = np.array([1.0] * 8 + [1.2] * 30)
    std, anomalous = np.full(values.size, 0.01), values > 1.1
    shift = shift_of(values, std, anomalous, (0.9, 1.1))
    assert shift is not None
    assert shift.value == pytest.approx(0.2)


def test_a_first_window_without_nominal_bounds_has_no_shift() -> None:
    one = np.ones(1)
    assert shift_of(one, 0.01 * one, np.zeros(1, dtype=np.bool_), (np.nan, np.nan)) is None


def alarms_of(window_of: Callable[[int, str], Diagnosis], windows: int = 14) -> list[AlarmRecord]:
    """Return the alarms that windows of all wheels leave in a history; they change from the tenth on."""
    with TemporaryDirectory() as folder, History(Path(folder, "h.sqlite3")) as history:
        for number in range(windows):
            for wheel in WHEELS:
                history.add(window_of(number, wheel))
        return history.alarms()


def test_a_shift_that_all_share_is_one_alarm_of_the_spacecraft() -> None:
    def window(number: int, wheel: str) -> Diagnosis:
        return diagnosis(number, severity=1.0 if 10 <= number < 14 else None, wheel=wheel)

    (alarm,) = alarms_of(window)
    assert (alarm.wheel, alarm.name, alarm.level) == (ALL_WHEELS, "viscous", "warning")
    assert alarm.reason.startswith("Viscous friction of all 4 wheels moved by +24.5 ±")
    assert alarm.advice == OWN_ADVICE[ALL_WHEELS]
    (alarm,) = alarms_of(window, 20)
    assert (alarm.wheel, alarm.phase) == (ALL_WHEELS, "returned")


@pytest.mark.parametrize(("factor", "open_"), [(1.03, False), (1.05, True)])
def test_a_wheel_that_moves_alone_has_an_alarm_before_its_windows_are_anomalous(factor: float, open_: bool) -> None:
    """Also where its own windows are undecided: the siblings decide them."""

    def window(number: int, wheel: str) -> Diagnosis:
        odd = wheel == "wheel_2" and number >= 10
        moved = moved_a_little(diagnosis(number, wheel=wheel), factor if odd else 1.0)
        return moved.model_copy(update={"verdict": "inconclusive"}) if odd and open_ else moved

    (alarm,) = alarms_of(window)
    assert (alarm.wheel, alarm.name, alarm.level) == ("wheel_2", "viscous", "watch")
    assert "apart from that of the other 3 wheels" in alarm.reason


@pytest.mark.parametrize(("factor", "alarms"), [(0.85, 1), (0.98, 0)])
def test_a_shift_that_all_share_is_reported_once_it_is_larger_than_the_nominal_range(
    factor: float, alarms: int
) -> None:
    windows = [moved_a_little(diagnosis(number), factor if number >= 10 else 1.0) for number in range(14)]
    found = alarms_of(lambda number, wheel: windows[number].model_copy(update={"wheel": wheel}))
    assert [(alarm.wheel, alarm.level) for alarm in found] == [(ALL_WHEELS, "watch")] * alarms
