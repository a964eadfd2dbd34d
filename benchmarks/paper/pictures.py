"""Redraws the paper's figures as SVG, with the same bytes for the same results."""

from __future__ import annotations

from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from benchmarks.accuracy.campaign import STAGES
from benchmarks.paper.benchmark import PAPER_ERROR, PaperBenchmark
from benchmarks.paper.bins import BinsSweep
from benchmarks.paper.examine import ERROR_BINS, ERROR_STEP, ORACLE
from benchmarks.paper.run_length import LONGEST_RUN, PAPER_WEIGHTS, SIMULATED_AT, RunLengths
from rwa_monitor.reporting.figures import svg
from rwa_monitor.samples import FloatArray

COLOURS: Final = {"paper": "#d55e00", ORACLE: "#009e73", "joint": "#0072b2"}  # Okabe and Ito
LINES: Final = ("-", "--", ":", "-.")
WANTED_RUN: Final = 1e6  # samples, the paper's aim for windows of 80,000
PAPER_SIGMA: Final = 0.024  # of the noise, normalised
PAPER_TIMES_S: Final = {"changepoints": 0.1, "assignment": 0.03, "classification": 0.001}


def pictures(found: PaperBenchmark) -> dict[str, str]:
    """Return all pictures: name and SVG document."""
    drawn = {
        "run_length": draw_run_lengths(found.run_lengths),
        "excess_rmse": draw_excess_rmse(found),
        "errors": draw_errors(found),
        "work": draw_work(found),
        "bins": draw_bins(found.bins),
        "times": draw_times(found),
    }
    # Letters as text, not as outlines: a tenth of the size, and searchable.
    with mpl.rc_context({"svg.fonttype": "none"}):
        return {name: f'<?xml version="1.0" encoding="utf-8"?>\n{svg(figure)}' for name, figure in drawn.items()}


def _sheet(width: float = 8.0, columns: int = 2) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(width, 3.0), layout="constrained")
    axes = list(figure.subplots(1, columns, squeeze=False)[0])
    for axis in axes:
        axis.grid(alpha=0.25)
    return figure, axes


def draw_run_lengths(curves: RunLengths) -> Figure:
    """Draw the average run length over w: for each W_b and ω(t), and for each size of the jump."""
    figure, (left, right) = _sheet()
    for a, acceleration in enumerate(curves.accelerations):
        for weight, colour in zip(PAPER_WEIGHTS, COLOURS.values(), strict=True):
            label = f"W_b = {weight:.0e}" if a == 1 else None
            left.plot(curves.half_widths, curves.by_weight[acceleration, weight], LINES[a], color=colour, label=label)
    for weight, colour in zip(PAPER_WEIGHTS, COLOURS.values(), strict=True):
        left.plot(curves.half_widths, curves.true[weight], color=colour, lw=4, alpha=0.3)
        for w in SIMULATED_AT:
            length = curves.simulated[w, weight].run_length
            if length.value < LONGEST_RUN:
                below, above = length.value - length.low, length.high - length.value
                left.errorbar([w], [length.value], [[below], [above]], fmt="o", ms=3, color=colour)
    left.set(xlabel="w [samples]", ylabel="ARL at 0.1 % missed [samples]", yscale="log", title="jump of 3 σ")
    for (jump, lengths), line in zip(curves.by_jump.items(), LINES, strict=True):
        right.plot(curves.half_widths, lengths, line, color=COLOURS["joint"], label=f"jump of {jump:g} σ")
    right.set(xlabel="w [samples]", yscale="log", title="W_b = 1e-4")
    for axis in (left, right):
        axis.axhline(WANTED_RUN, color="black", lw=0.8)
        axis.legend(fontsize=7, loc="lower right")
    return figure


def draw_excess_rmse(found: PaperBenchmark) -> Figure:
    """Draw the histograms of the excess RMSE, naive and with changepoints, and plot one against the other."""
    figure, (left, right, both) = _sheet(11.0, 3)
    naive = [one.naive_excess_rmse for one in found.examined]
    left.hist(naive, bins=30, color="0.6")
    left.axvline(float(np.mean(naive)), color="black")
    left.set(xlabel="excess RMSE, one dry coefficient", ylabel="windows")
    values = {who: 1e3 * np.array([one.fitted[who].excess_rmse for one in found.examined]) for who in COLOURS}
    edges = np.histogram_bin_edges(np.clip(np.concatenate(list(values.values())), -1.0, 3.0), bins=40)
    for (who, value), line in zip(values.items(), LINES, strict=False):
        clipped = np.clip(value, -1.0, 3.0)
        right.hist(clipped, edges.tolist(), histtype="step", color=COLOURS[who], linestyle=line, label=who)
    right.set(xlabel="1000 × excess RMSE with changepoints (3: more)", yscale="log")
    right.legend(fontsize=7)
    for who, marker in (("paper", "."), ("joint", "+")):
        both.plot(naive, np.clip(values[who], -1.0, 3.0), marker, ms=4, ls="", color=COLOURS[who], label=who)
    both.set(xlabel="excess RMSE, one dry coefficient", ylabel="1000 × with changepoints")
    both.legend(fontsize=7)
    return figure


def draw_errors(found: PaperBenchmark) -> Figure:
    """Draw the survival functions of the absolute error and of Gaussian noise."""
    figure, (axis,) = _sheet(5.0, 1)
    at = ERROR_STEP * np.arange(ERROR_BINS)
    for who, line in zip(COLOURS, LINES, strict=False):
        counts = found.errors(who)
        survival = counts[::-1].cumsum()[::-1] / counts.sum()
        axis.plot(at[survival > 0], survival[survival > 0], line, color=COLOURS[who], label=who)
    gaussian = 2.0 * stats.norm.sf(at / PAPER_SIGMA)
    axis.plot(at[gaussian > 1e-8], gaussian[gaussian > 1e-8], color="black", lw=0.8, label=f"Gaussian, {PAPER_SIGMA}")
    axis.axvline(PAPER_ERROR, color="0.5", lw=0.8, label="the paper follows to here")
    axis.set(xlabel="absolute error, normalised", ylabel="share of samples beyond", yscale="log", ylim=(1e-8, 1))
    axis.legend(fontsize=7)
    return figure


def draw_work(found: PaperBenchmark) -> Figure:
    """Draw the states that the assignment expands over the number of candidates, by rejections."""
    figure, axes = _sheet()
    groups = (("none rejected", 0, 0, "o"), ("1 to 3", 1, 3, "s"), ("more", 4, 10**9, "^"))
    for axis, who in zip(axes, ("paper", "joint"), strict=True):
        for (label, least, most, marker), colour in zip(groups, ("#009e73", "#0072b2", "#d55e00"), strict=True):
            part = [one.work[who] for one in found.examined if least <= one.work[who].rejected <= most]
            axis.plot([w.candidates for w in part], [w.states for w in part], marker, ms=3, color=colour, label=label)
        axis.set(xlabel="candidates", yscale="log", title=f"method {who}")
        axis.legend(fontsize=7, title="rejected")
    axes[0].set_ylabel("states expanded")
    return figure


def draw_bins(swept: BinsSweep) -> Figure:
    """Draw the misclassification over the number of bins, with the range over the splits."""
    figure, (axis,) = _sheet(5.0, 1)
    for name, wrong, colour in (("training", swept.training, "#009e73"), ("validation", swept.validation, "#d55e00")):
        axis.plot(swept.bins, 100 * np.nanmean(wrong, axis=1), "o-", ms=3, color=colour, label=name)
        axis.fill_between(
            swept.bins, 100 * np.nanmin(wrong, axis=1), 100 * np.nanmax(wrong, axis=1), color=colour, alpha=0.2, lw=0
        )
    axis.set(xlabel="bins", ylabel="misclassified [%]", xscale="log", xticks=swept.bins, xticklabels=swept.bins)
    axis.minorticks_off()
    axis.legend(fontsize=7)
    return figure


def draw_times(found: PaperBenchmark) -> Figure:
    """Draw the time of each stage, by method, with the paper's means."""
    figure, (axis,) = _sheet(6.0, 1)
    for m, times in enumerate(found.times):
        values: list[FloatArray] = [1e3 * times.seconds[stage] for stage in STAGES]
        axis.boxplot(
            values,
            positions=np.arange(len(STAGES)) + 0.25 * (m - 0.5),
            widths=0.2,
            whis=(0, 100),
            boxprops={"color": COLOURS[times.method]},
            medianprops={"color": COLOURS[times.method]},
            manage_ticks=False,
        )
        axis.plot([], [], color=COLOURS[times.method], label=times.method)
    paper = [1e3 * PAPER_TIMES_S[stage] for stage in STAGES]
    axis.plot(range(len(STAGES)), paper, "k_", ms=20, label="the paper, mean")
    axis.set(yscale="log", ylabel="ms", xticks=range(len(STAGES)), xticklabels=STAGES)
    axis.legend(fontsize=7)
    return figure
