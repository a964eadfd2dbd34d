"""The figures of a discrepancy report, drawn without a display; as SVG the same input gives the same bytes."""

import io
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rwa_monitor.discrepancy.result import Search, nested_models
from rwa_monitor.reporting.residual_views import View, base_residual, means_in_bins
from rwa_monitor.samples import TINY, FloatArray, IntArray

BASE, EXTENDED, MEASURED = "#c1440e", "#1f6f8b", "#8a8a8a"  # orange-red, teal, grey: distinct if colour-blind, too
AS_IT_IS, WITH_EFFECTS = "simulation as it is", "simulation extended"
STYLES: Final[dict[str, dict[str, Any]]] = {
    AS_IT_IS: {"color": BASE, "ls": "--"},
    WITH_EFFECTS: {"color": EXTENDED, "ls": "-"},
}
FRICTION: Final = "friction torque [N m]"
MAX_POINTS: Final = 2500  # of a line in a figure
STANDARD_ERRORS: Final = 2.0  # half-length of the error bars of all views
STEADY_SHARE: Final = 0.1  # of the largest acceleration, below which the speed counts as steady
BIN_RATIO: Final = 0.1  # width of a bin of the speed, as a share of the speed
SLOW_SHARE: Final = 0.002  # of the top speed, below which bins get no narrower


def _residuals(search: Search) -> dict[str, FloatArray]:
    """Return the residual of each simulation by its name, s·torque [N m], float64 (n,)."""
    found = {AS_IT_IS: base_residual(search.problem, search.extended)}
    if search.extended.terms:
        found[WITH_EFFECTS] = search.extended.fit.residual
    return found


def overlay(search: Search) -> Figure:
    """Draw measured friction and both simulations of a manoeuvre, residuals, and a detail where they differ most."""
    problem, record = search.problem, search.problem.records[0]
    end = int(problem.starts[1])
    time_s = record.channels.time_s[problem.slot[:end]]
    sign = problem.sign[:end]
    measured = problem.z_measured[:end] * sign
    pulled_in = (problem.z_measured - problem.z)[:end]
    left = {name: (residual[:end] + pulled_in) * sign for name, residual in _residuals(search).items()}
    difference = [*left.values()][-1] - left[AS_IT_IS]
    width = min(MAX_POINTS // 2, max(end // 6, 2))
    centre = int(np.argmax(np.convolve(difference**2, np.ones(max(width // 6, 1)), mode="same")))
    zoom = slice(max(centre - width // 2, 0), min(centre + width // 2, end))

    figure = Figure(figsize=(11, 9.6), layout="constrained")
    axes = figure.subplot_mosaic("A;B;D;C", height_ratios=[0.8, 1.2, 1.2, 1.3])
    axes["A"].plot(*_thin(time_s, record.channels.speed_rad_s[problem.slot[:end]]), color="black", lw=0.8)
    axes["A"].set(ylabel="speed ω [rad/s]", title="the manoeuvre")
    axes["B"].plot(*_thin(time_s, measured), color=MEASURED, lw=2.0, label="measured")
    axes["C"].plot(time_s[zoom], measured[zoom], ".", color=MEASURED, ms=2.5 + 100.0 / (zoom.stop - zoom.start))
    for name, residual in left.items():
        for axis, part in ((axes["B"], slice(0, end)), (axes["C"], zoom)):
            axis.plot(*_thin(time_s[part], (measured - residual)[part]), lw=1.3, label=name, **STYLES[name])
        axes["D"].plot(*_thin(time_s, residual), lw=0.7, color=STYLES[name]["color"])
    axes["B"].set(ylabel=FRICTION, title="friction, measured and simulated")
    axes["C"].set(ylabel=FRICTION, title="close-up where the simulations differ most")
    axes["D"].set(ylabel="difference [N m]", title="measured less simulated")
    for name in "ABD":
        axes[name].sharex(axes["B"])
    for axis in axes.values():
        axis.set_xlabel("time [s]")
        _finish(axis)
    figure.legend(*axes["B"].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def friction_over_speed(search: Search) -> Figure:
    """Draw friction over speed: measured, separately by the sign of d|ω|/dt, and of both simulations.

    The jumps are removed: all is drawn at the lowest level of the dry friction.
    """
    problem, level = search.problem, search.extended.fit.level
    speed = problem.speed * problem.sign
    at_rest = (problem.z_measured - level + level.min()) * problem.sign
    gaining = problem.sign * problem.gather([record.channels.acceleration_rad_s2 for record in problem.records])
    steady = STEADY_SHARE * np.nanmax(np.abs(gaining), initial=0.0)

    figure = Figure(figsize=(11, 4.6), layout="constrained")
    axis = figure.subplots()
    for name, marker, part in (
        ("measured, |ω| grows", "^", gaining > steady),
        ("measured, |ω| falls", "v", gaining < -steady),
        ("measured, steady", ".", np.abs(gaining) <= steady),
    ):
        x, y, count = _means_over(speed[part], at_rest[part])
        error = STANDARD_ERRORS * np.sqrt(problem.noise.long_run_variance / count)
        axis.errorbar(x, y, error, fmt=marker, ms=4, lw=0.8, color=MEASURED, label=name)
    for name, residual in _residuals(search).items():
        x, y, _ = _means_over(speed, at_rest - residual * problem.sign)
        for k, side in enumerate((x < 0, x > 0)):
            axis.plot(x[side], y[side], lw=1.4, label=name if k else None, **STYLES[name])
    axis.set(xlabel="speed ω [rad/s]", ylabel=f"{FRICTION} without its jumps")
    _finish(axis)
    axis.legend(fontsize=8)
    return figure


def formula(latex: str) -> Figure:
    """Draw a formula of the catalogue, black and without background."""
    figure = Figure(figsize=(0.1, 0.1))
    figure.text(0.0, 0.0, f"${latex}$")
    return figure


def view_picture(view: View, title: str, x_label: str, y_label: str, both: bool) -> Figure:
    """Draw one residual view: the base model's residual and, if `both`, the extended model's."""
    figure = Figure(figsize=(5.4, 3.4), layout="constrained")
    axis = figure.subplots()
    expected = np.broadcast_to(view.base.expected, view.base.x.shape)
    axis.plot(view.base.x, expected, color="black", lw=0.8, ls="--", label="if nothing were missing")
    extended = [(view.extended, EXTENDED, "s", "extended")] if both else []
    for curve, colour, marker, label in (*extended, (view.base, BASE, "o", "as it is")):
        error = STANDARD_ERRORS * curve.error
        axis.errorbar(curve.x, curve.y, error, fmt=marker, ms=3.5, lw=1, capsize=2, color=colour, label=label)
    axis.set(xlabel=x_label, ylabel=y_label)
    axis.set_title(title, fontweight="bold")
    if view.name == "tails":
        axis.set_yscale("log")
        axis.set_ylim(bottom=1e-6)
    _finish(axis)
    axis.legend(fontsize=8)
    return figure


def gains_picture(search: Search) -> Figure:
    """Draw each nested model's gain on held-out data over the base model, and its number of jumps, if there are any."""
    nested = nested_models(search)
    figure = Figure(figsize=(9, 0.55 * len(nested) + 1.3), layout="constrained")
    counts = [model.jumps for model in nested]
    left, *others = np.ravel(figure.subplots(1, 1 + any(counts), sharey=True))
    at = np.arange(len(nested))
    colours = [BASE, *([EXTENDED] * (len(nested) - 1))]
    for k, model in enumerate(nested):
        left.errorbar(model.total, k, xerr=model.total_half, fmt="os"[k > 0], color=colours[k], capsize=4, ms=6)
    left.axvline(0.0, color="black", lw=0.8)
    left.set(
        xlabel="log score gained [nats per sample], 95 %",
        yticks=at,
        yticklabels=[model.name for model in nested],
    )
    left.xaxis.set_major_locator(MaxNLocator(5))
    left.invert_yaxis()
    left.grid(alpha=0.25)
    for right in others:
        right.bar_label(right.barh(at, counts, color=colours, height=0.55), padding=3)
        right.set(xlabel="jumps needed [-]")
        right.xaxis.set_major_locator(MaxNLocator(5, integer=True))
        right.margins(x=0.12)
    return figure


def svg(figure: Figure, *, tight: bool = False) -> str:
    """Return a figure as an <svg> element, without date or random ids; `tight` crops it to its content."""
    text = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "rwa-monitor", "font.size": 9}):
        figure.savefig(text, format="svg", metadata={"Date": None}, bbox_inches="tight" if tight else None)
    document = text.getvalue()
    return document[document.index("<svg") :]


def _finish(axis: Axes) -> None:
    """Add a grid to axes, and a power of ten for small or large values."""
    axis.grid(alpha=0.25)
    if axis.get_yscale() == "linear":
        axis.ticklabel_format(axis="y", scilimits=(-2, 4), useMathText=True)


def _means_over(speed: FloatArray, torque: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return means of speed and torque and the samples in each, in bins whose width is a share of the speed.

    No bin holds both directions, and bins are narrow near zero, where friction changes fastest.
    """
    slow = SLOW_SHARE * np.abs(speed).max(initial=TINY)
    bin_of = np.sign(speed) * np.ceil(np.log1p(np.abs(speed) / slow) / BIN_RATIO)
    (x, y), count = means_in_bins((bin_of - bin_of.min(initial=0.0)).astype(np.int64), speed, torque)
    return x, y, count


def _thin(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and largest value of each of MAX_POINTS/2 pieces, so that no spike is lost."""
    if x.size <= MAX_POINTS:
        return x, y
    pieces = np.array_split(np.arange(x.size), MAX_POINTS // 2)
    at = np.concatenate([sorted((p[np.argmin(y[p])], p[np.argmax(y[p])])) for p in pieces])
    return x[at], y[at]
