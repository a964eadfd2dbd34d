"""The main pictures, as matplotlib figures: `rwa_monitor.plot.window(samples, diagnosis).savefig("window.png")`.

Figures are made without a display and without pyplot: nothing is shown, no global state is changed, and a notebook
shows the figure that is returned. Colours suit colour-blind readers, and no picture relies on colour alone.
"""

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.constants import milli

from rwa_monitor.errors import InputError
from rwa_monitor.messages import Diagnosis
from rwa_monitor.reporting.figures import MAX_POINTS
from rwa_monitor.reporting.figures import gains_picture as gains
from rwa_monitor.reporting.figures import overlay as discrepancy
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, FloatArray, Samples
from rwa_monitor.wheel.torque_balance import friction_of
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel

__all__ = ["discrepancy", "gains", "window"]

COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00")  # Okabe and Ito, of the switching systems
NOT_OF_A_SYSTEM: Final = "#555555"
GROUND: Final = "0.6"


def window(samples: Samples, diagnosis: Diagnosis, wheel: Wheel | None = None) -> Figure:
    """Draw one window as diagnosed: speed; friction with its jumps; friction of each switching system.

    Parameters
    ----------
    samples
        Telemetry that covers the window, n samples; it may be longer.
    diagnosis
        The diagnosis of that window.
    wheel
        The wheel it was diagnosed with, for friction that is derived from current; None: the built-in wheel.

    Raises
    ------
    InputError
        If no sample lies in the window, or friction is neither given nor can be derived.
    """
    friction_Nm = friction_of(samples, wheel or built_in_wheel())
    inside = (samples.time_ns >= diagnosis.window_start_ns) & (samples.time_ns < diagnosis.window_end_ns)
    if not inside.any():
        raise InputError("samples", f"none lies in the window that begins at {diagnosis.window_start_ns} ns")
    minutes = _minutes(samples.time_ns[inside], diagnosis)
    speed_rad_s = samples.speed_rad_s[inside]
    every = max(speed_rad_s.size // MAX_POINTS, 1)
    colours = dict(zip(diagnosis.friction.fss, COLOURS, strict=False))

    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(1, 2, 1.4))
    top.plot(minutes[::every], speed_rad_s[::every], lw=0.8, color="0.4")
    top.set(ylabel="speed\n[rad/s]", title=f"{diagnosis.verdict}: {diagnosis.reason.split(' (')[0]}")
    top.title.set_fontsize(9)
    dry = _without_viscous(friction_Nm[inside], speed_rad_s, diagnosis)
    middle.plot(minutes[::every], dry[::every] / milli, ".", ms=1.0, color=GROUND)
    middle.set_ylabel("friction less\nviscous [mN m]")
    for jump in diagnosis.changepoints:
        middle.axvline(
            _minutes(jump.time_ns, diagnosis),
            lw=0.8,
            color=colours.get(jump.fss, NOT_OF_A_SYSTEM),
            ls="-" if jump.fss in colours else ":",
        )
    _draw_systems(bottom, diagnosis, colours)
    bottom.set(ylabel="of the systems\n[mN m]", xlabel="time in the window [min]")
    return figure


def _minutes(time_ns: Any, diagnosis: Diagnosis) -> Any:
    """Return a time, or an array of times, since the window's begin [min]."""
    return (time_ns - diagnosis.window_start_ns) / (60 * NANOSECONDS_PER_SECOND)


def _without_viscous(friction_Nm: FloatArray, speed_rad_s: FloatArray, diagnosis: Diagnosis) -> FloatArray:
    """Return friction along the motion without its viscous part [N m], NaN at zero speed."""
    viscous = diagnosis.friction.viscous.value or 0.0
    direction = np.sign(speed_rad_s)
    dry = direction * (friction_Nm - viscous * speed_rad_s)
    return np.where(direction == 0, np.nan, dry)


def _draw_systems(axis: Axes, diagnosis: Diagnosis, colours: dict[str, str]) -> None:
    """Draw the friction of each system as steps, with the nominal bound of those that are anomalous."""
    end = _minutes(diagnosis.window_end_ns, diagnosis)
    a_slot = end / diagnosis.samples
    for name, system in diagnosis.friction.fss.items():
        at = [a_slot * index for index in system.start_index]
        torque = [value / milli for value in system.friction_Nm]
        if at:
            axis.step([*at, end], [*torque, torque[-1]], where="post", color=colours.get(name), label=name)
        anomaly = diagnosis.anomalies.get(name)
        if anomaly is not None and anomaly.active and anomaly.nominal_high is not None:
            bound = anomaly.nominal_high / milli
            axis.axhline(bound, ls=":", lw=0.9, color=colours.get(name), label=f"nominal bound of {name}")
    if axis.get_legend_handles_labels()[0]:
        axis.legend(fontsize=7, loc="upper right")
