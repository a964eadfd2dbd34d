"""The pictures show what the diagnosis says: what is drawn is read back from the figures."""

from __future__ import annotations

import io

import numpy as np
import pytest
from matplotlib.figure import Figure

import rwa_monitor as rwa
from rwa_monitor import plot
from rwa_monitor.errors import InputError
from rwa_monitor.wheel.wheel import Window

WINDOW = 20_000


@pytest.fixture(scope="module")
def wheel() -> rwa.Wheel:
    return rwa.read_wheel().model_copy(update={"window": Window(samples=WINDOW, hop=WINDOW)})


@pytest.fixture(scope="module")
def telemetry(wheel: rwa.Wheel) -> rwa.Telemetry:
    return rwa.simulate(rwa.Scenario(duration_s=5000.0), wheel, seed=5)


@pytest.fixture(scope="module")
def diagnoses(wheel: rwa.Wheel, telemetry: rwa.Telemetry) -> list[rwa.Diagnosis]:
    return rwa.diagnose(telemetry.samples, wheel)


def drawn(figure: Figure) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()


def test_a_window_shows_its_jumps_and_its_systems(
    telemetry: rwa.Telemetry, diagnoses: list[rwa.Diagnosis], wheel: rwa.Wheel
) -> None:
    diagnosis = diagnoses[1]
    assert diagnosis.changepoints, "a window without jumps shows nothing here"
    figure = plot.window(telemetry.samples, diagnosis, wheel)
    _, middle, bottom = figure.axes
    dots, *jumps = middle.lines
    minutes = [(jump.time_ns - diagnosis.window_start_ns) / 60e9 for jump in diagnosis.changepoints]
    np.testing.assert_allclose([line.get_xdata()[0] for line in jumps], minutes)
    # Friction less viscous is base dry plus that of the systems: the median distance of a dot is that of the noise.
    level = np.full(WINDOW, diagnosis.friction.base_dry.value)
    for system in diagnosis.friction.fss.values():
        lengths = np.diff([*system.start_index, WINDOW])
        level += np.repeat(system.friction_Nm, lengths)
    every = WINDOW // dots.get_xdata().size
    distance = np.nanmedian(np.abs(dots.get_ydata() - 1e3 * level[::every]))
    assert 0.5 < distance / (1e3 * diagnosis.fit.noise_std_Nm) < 1.0  # 0.674 for Gaussian noise
    assert [line.get_label() for line in bottom.lines] == list(diagnosis.friction.fss)
    assert drawn(figure).startswith(b"\x89PNG")


def test_friction_is_derived_where_it_is_not_given(
    telemetry: rwa.Telemetry, diagnoses: list[rwa.Diagnosis], wheel: rwa.Wheel
) -> None:
    given = telemetry.samples
    derived = rwa.Samples(given.time_ns, given.speed_rad_s, motor_current_A=given.motor_current_A)
    pictures = [plot.window(samples, diagnoses[0], wheel).axes[1].lines[0].get_ydata() for samples in (given, derived)]
    assert np.nanmedian(np.abs(pictures[0] - pictures[1])) < 3 * 1e3 * diagnoses[0].fit.noise_std_Nm


def test_a_window_without_samples_is_refused(telemetry: rwa.Telemetry, diagnoses: list[rwa.Diagnosis]) -> None:
    with pytest.raises(InputError, match="none lies in the window"):
        plot.window(telemetry.samples[:100], diagnoses[1])


def test_a_trend_shows_each_window(diagnoses: list[rwa.Diagnosis]) -> None:
    figure = plot.trend(diagnoses)
    for axis, part in zip(figure.axes, ("base_dry", "viscous"), strict=True):
        values = [getattr(diagnosis.friction, part).value for diagnosis in diagnoses]
        np.testing.assert_array_equal(axis.lines[0].get_ydata(), values)
    assert drawn(figure).startswith(b"\x89PNG")
    with pytest.raises(InputError, match="none given"):
        plot.trend([])


def test_a_trend_is_drawn_to_its_limit(diagnoses: list[rwa.Diagnosis]) -> None:
    # One diagnosis, repeated with a viscous friction that grows by a tenth of the nominal range a window.
    first = diagnoses[0]
    low, high = first.anomalies["viscous"].nominal_low, first.anomalies["viscous"].nominal_high
    step, length_ns = (high - low) / 10, first.window_end_ns - first.window_start_ns

    def later(k: int) -> rwa.Diagnosis:
        viscous = first.friction.viscous.model_copy(update={"value": low + k * step, "std": step / 10})
        friction = first.friction.model_copy(update={"viscous": viscous})
        times = {"window_start_ns": k * length_ns, "window_end_ns": (k + 1) * length_ns}
        return first.model_copy(update={"friction": friction, **times})

    course = [later(k) for k in range(12)]
    far = low + 20 * step
    figure = plot.trend(course, {"viscous": far})
    dry, viscous = figure.axes
    lines = {line.get_label(): line for line in viscous.lines}
    assert "trend, 95 % band" not in {line.get_label() for line in dry.lines}
    hours = length_ns / 3600e9
    begin, end = lines["limit reached, 95 %"].get_xdata()
    assert begin < 20.5 * hours < end
    assert lines["trend, 95 % band"].get_xdata()[-1] == pytest.approx(end)
    assert lines["limit"].get_ydata()[0] == far
    assert drawn(figure).startswith(b"\x89PNG")
