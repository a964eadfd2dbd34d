"""The pictures of a discrepancy report: drawn without a display, and as SVG the same bytes for the same input."""

from __future__ import annotations

import io
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rwa_monitor.discrepancy.find import Search
from rwa_monitor.discrepancy.views import View, base_residual
from rwa_monitor.samples import FloatArray

BASE, EXTENDED, MEASURED = "#c1440e", "#1f6f8b", "#7a7a7a"  # orange-red, teal, grey: apart for colour-blind eyes too
MAX_POINTS: Final = 2500  # of a line in a picture
STANDARD_ERRORS: Final = 2.0  # that the bars of all views show
ZOOM_SLOTS: Final = 1200  # of the close-up


def overlay(search: Search) -> Figure:
    """Draw measured friction and both simulations for the same manoeuvre, with a close-up where they part most."""
    problem, record = search.problem, search.problem.records[0]
    end = int(problem.starts[1])
    time_s = record.channels.time_s[problem.slot[:end]]
    sign = problem.sign[:end]
    measured = (problem.z_measured[:end]) * sign
    extended = measured - (search.extended.fit.residual[:end] + (problem.z_measured - problem.z)[:end]) * sign
    base = measured - (base_residual(problem, search.extended)[:end] + (problem.z_measured - problem.z)[:end]) * sign
    apart = np.convolve((extended - base) ** 2, np.ones(min(200, end)), mode="same")
    centre = int(np.argmax(apart))
    zoom = slice(max(centre - ZOOM_SLOTS // 2, 0), min(centre + ZOOM_SLOTS // 2, end))

    factor, unit = torque_unit(float(np.max(np.abs(measured))))
    figure = Figure(figsize=(11, 7.2), layout="constrained")
    axes = figure.subplot_mosaic("A;B;C", height_ratios=[1, 1.3, 1.3])
    axes["A"].plot(*_thin(time_s, record.channels.speed_rad_s[problem.slot[:end]]), color="black", lw=0.8)
    axes["A"].set(ylabel="speed ω [rad/s]", title="Measured and simulated friction for the same manoeuvre")
    for axis, part, note in ((axes["B"], slice(0, end), ""), (axes["C"], zoom, "close-up where the models part most")):
        axis.plot(*_thin(time_s[part], measured[part] * factor), color=MEASURED, lw=0.5, alpha=0.7, label="measured")
        axis.plot(*_thin(time_s[part], base[part] * factor), color=BASE, lw=1.3, label="simulation as it is")
        if search.extended.terms:
            axis.plot(
                *_thin(time_s[part], extended[part] * factor), color=EXTENDED, lw=1.3, label="simulation extended"
            )
        axis.set(ylabel=f"friction torque [{unit}]", title=note)
        axis.grid(alpha=0.25)
    axes["C"].set_xlabel("time [s]")
    axes["B"].legend(loc="upper right", ncols=3, fontsize=9)
    return figure


def view_picture(view: View, both: bool) -> Figure:
    """Draw one residual view: the base model's residual and, if `both`, the extended model's."""
    figure = Figure(figsize=(5.4, 3.2), layout="constrained")
    axis = figure.subplots()
    axis.plot(view.base.x, view.expected, color="black", lw=0.8, ls="--", label="if nothing were missing")
    if both:
        _bars(axis, view.extended.x, view.extended.y, view.extended.error, EXTENDED, "s", "extended")
    _bars(axis, view.base.x, view.base.y, view.base.error, BASE, "o", "as it is")
    axis.set(xlabel=view.x_label, ylabel=view.y_label, title=view.title)
    if view.name == "tails":
        axis.set_yscale("log")
        axis.set_ylim(bottom=1e-6)
    else:
        axis.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4))
    axis.grid(alpha=0.25)
    axis.legend(fontsize=8)
    return figure


def ladder_picture(search: Search) -> Figure:
    """Draw the held-out RMSE and the number of jumps of each model of the ladder."""
    names = ["as it is", *(f"+ {search.mean.ladder[i].names[-1]}" for i in range(1, len(search.mean.ladder)))]
    figure = Figure(figsize=(7, 0.6 * len(names) + 1.4), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    at = np.arange(len(names))
    colours = [BASE, *([EXTENDED] * (len(names) - 1))]
    factor, unit = torque_unit(max(score.rmse_Nm for score in search.scores))
    left.barh(at, [score.rmse_Nm * factor for score in search.scores], color=colours)
    left.axvline(search.problem.noise.std * factor, color="black", ls="--", lw=1)
    left.set(xlabel=f"held-out RMSE [{unit}] (dashed: noise)", yticks=at, yticklabels=names)
    left.invert_yaxis()
    right.barh(at, [model.fit.jumps.size for model in search.mean.ladder], color=colours)
    right.set(xlabel="jumps needed")
    return figure


def torque_unit(size_Nm: float) -> tuple[float, str]:
    """Return factor and name of the unit in which a torque [N m] has one to three digits before the point."""
    for factor, unit in ((1.0, "N m"), (1e3, "mN m"), (1e6, "µN m")):
        if abs(size_Nm) * factor >= 1.0:
            return factor, unit
    return 1e9, "nN m"


def svg(figure: Figure) -> str:
    """Return a figure as an <svg> element, without date or random ids."""
    text = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "rwa-monitor", "font.size": 9}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    document = text.getvalue()
    return document[document.index("<svg") :]


def _bars(axis: Axes, x: FloatArray, y: FloatArray, error: FloatArray, colour: str, marker: str, label: str) -> None:
    axis.errorbar(x, y, STANDARD_ERRORS * error, fmt=marker, ms=3.5, lw=1, capsize=2, color=colour, label=label)


def _thin(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Keep smallest and largest value of each of MAX_POINTS/2 pieces, so that no spike is lost."""
    if x.size <= MAX_POINTS:
        return x, y
    pieces = np.array_split(np.arange(x.size), MAX_POINTS // 2)
    at = np.concatenate([sorted((p[np.argmin(y[p])], p[np.argmax(y[p])])) for p in pieces])
    return x[at], y[at]
