"""The pictures show what the diagnosis states: what is drawn is read back from the figures."""

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
