"""How a diagnosis looks to a person: verdict and reason first, then the parts of the friction."""

from __future__ import annotations

from collections import Counter
from typing import Final

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from rwa_monitor.diagnosis.verdict import MIN_COVERAGE, quantity, span
from rwa_monitor.messages import Anomaly, Diagnosis, Quantity
from rwa_monitor.words import time_text

VERDICT_STYLE: Final = {"nominal": "bold green", "anomalous": "bold red", "inconclusive": "bold yellow"}
UNKNOWN: Final = "–"


def has_too_few_samples(diagnosis: Diagnosis) -> bool:
    """Return whether too few of a window's slots hold a sample for any part of its friction to be judged."""
    return diagnosis.coverage < MIN_COVERAGE


def render(diagnosis: Diagnosis) -> RenderableType:
    """Return the picture of one window's diagnosis; only the reason where the window has too few samples."""
    wheel = f"{diagnosis.spacecraft}/{diagnosis.wheel}" if diagnosis.spacecraft else diagnosis.wheel
    start, end = time_text(diagnosis.window_start_ns), time_text(diagnosis.window_end_ns)
    head = Text.assemble(
        (f"{diagnosis.source}  {wheel}" if diagnosis.source else wheel, "bold"),
        f"  {start} to {end}  {diagnosis.samples} slots",
        f"  coverage {100 * diagnosis.coverage:.1f} %",
        "  partial" if diagnosis.partial else "",
    )
    verdict = Text.assemble(
        (diagnosis.verdict.upper(), VERDICT_STYLE[diagnosis.verdict]),
        " (undecided)" if diagnosis.verdict == "inconclusive" else "",
        f"  {diagnosis.explanation or diagnosis.reason}",
    )
    if has_too_few_samples(diagnosis):
        return Group(head, verdict)
    return Group(head, verdict, _anomalies(diagnosis), _friction(diagnosis))


def _anomalies(diagnosis: Diagnosis) -> Table:
    """Return the table of what can be anomalous and what is."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 2))
    for column in ("", "anomalous", "probability", "severity", "estimate", "nominal"):
        table.add_column(column, style="" if column else "bold", no_wrap=True)
    for name, anomaly in diagnosis.anomalies.items():
        known = anomaly.nominal_low is not None and anomaly.nominal_high is not None
        table.add_row(
            name,
            _called(anomaly, diagnosis) if known else Text("not judged"),
            f"{anomaly.probability:.3f}" if known else UNKNOWN,
            _severity(anomaly, decided=diagnosis.verdict != "inconclusive"),
            quantity(anomaly.estimate, anomaly.unit),
            span(anomaly.nominal_low, anomaly.nominal_high, anomaly.unit) if known else UNKNOWN,
        )
    return table


def _called(anomaly: Anomaly, diagnosis: Diagnosis) -> Text:
    """Return whether an anomaly is called; no all-clear is given by an inconclusive verdict or an inadequate model."""
    if anomaly.active and diagnosis.verdict == "anomalous":
        return Text("yes", VERDICT_STYLE["anomalous"])
    if anomaly.active or diagnosis.verdict == "inconclusive" or not diagnosis.model_adequate:
        return Text("undecided", VERDICT_STYLE["inconclusive"])
    return Text("no")


def _severity(anomaly: Anomaly, *, decided: bool) -> str:
    if anomaly.severity is None:
        return UNKNOWN
    if anomaly.active and not decided:
        return "undecided"
    return f"{anomaly.severity:.2f} ± {anomaly.severity_std or 0.0:.2f}"


def _friction(diagnosis: Diagnosis) -> Text:
    """Return the lines on friction, jumps and fit."""
    friction, fit = diagnosis.friction, diagnosis.fit
    jumps = Counter(changepoint.fss for changepoint in diagnosis.changepoints)
    suspicion = f", perhaps {diagnosis.suspected_effect}" if diagnosis.suspected_effect else ""
    by_system = ", ".join(f"{count} {name}" for name, count in sorted(jumps.items()))
    lines = [
        f"  friction      base dry {_with_std(friction.base_dry)}, viscous {_with_std(friction.viscous)}",
        f"  changepoints  {sum(jumps.values())}{f': {by_system}' if jumps else ''}",
        f"  fit           rmse {quantity(fit.rmse_Nm, 'N m')}, noise {quantity(fit.noise_std_Nm, 'N m')}; model "
        + ("adequate" if diagnosis.model_adequate else f"inadequate{suspicion}"),
    ]
    return Text("\n".join(lines))


def _with_std(measured: Quantity) -> str:
    if measured.std is None:
        return quantity(measured.value, measured.unit)
    return f"{quantity(measured.value, measured.unit)} ± {quantity(measured.std, measured.unit)}"
