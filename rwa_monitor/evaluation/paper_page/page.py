"""The page of Markdown: each table and figure of the paper beside what was measured here."""

from __future__ import annotations

from rwa_monitor.evaluation.paper_page.run_length import PAPER_RUN_LENGTHS, PAPER_WEIGHTS, PAPER_WINDOW, RunLengths
from rwa_monitor.evaluation.report import table


def run_length_section(curves: RunLengths) -> str:
    """Write the section on the average run length."""
    at = curves.half_widths.index(PAPER_WINDOW)
    rows = [
        [f"{acceleration:.2g}", *(f"{curves.by_weight[acceleration, w][at]:.2g}" for w in PAPER_WEIGHTS)]
        for acceleration in curves.accelerations
    ]
    paper = ["the paper, ω not stated", *(_paper_run_length(w) for w in PAPER_WEIGHTS)]
    header = ["steady change of ω/ω_nominal per sample", *(f"W_b = {w:.0e}" for w in PAPER_WEIGHTS)]
    return (
        "## Average run length at 0.1 % missed jumps\n\n"
        f"Samples between false alarms at w = {PAPER_WINDOW}, for a jump of 3 σ, in closed form. It depends on how the "
        "speed moves, which the paper does not say; the second row is the steady acceleration that gives its figure "
        "for W_b = 1e-8, and its figure for 1e-4 then comes out too.\n\n" + table(header, [*rows, paper])
    )


def _paper_run_length(weight: float) -> str:
    given = PAPER_RUN_LENGTHS.get(weight)
    return f"about {given:.0e}" if given is not None else "not given"
