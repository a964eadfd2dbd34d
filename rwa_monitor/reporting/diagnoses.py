"""Diagnoses as text: one window, and the trend of a wheel's friction over many.

    for trend in wheel_trends(diagnoses).values():
        print(trend.sentence())

Each coefficient is extrapolated to the bound of its nominal range, or to a limit that the caller gives.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from rwa_monitor.diagnosis.trend import Reach, Trend, find_trend
from rwa_monitor.diagnosis.verdict import MIN_COVERAGE, quantity, span, title
from rwa_monitor.messages import Anomaly, Diagnosis, Message, Number, Quantity, Share
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, SECONDS_PER_DAY, SECONDS_PER_HOUR
from rwa_monitor.wheel.wheel import RESERVED_ANOMALIES
from rwa_monitor.words import time_text

SMALLEST_P: Final = 1e-9  # a smaller p-value is given as a bound: it depends on Gaussian tails


class EstimateRecord(Message):
    """One estimate of one window: SI units, None where it is not known; its nominal range, and what was diagnosed."""

    window_start_ns: int
    window_end_ns: int
    value: Number | None
    std: Number | None
    nominal_low: Number | None
    nominal_high: Number | None
    unit: str
    name: str
    probability: Share
    severity: Number | None
    active: bool


def estimates_of(diagnosis: Diagnosis) -> Iterator[EstimateRecord]:
    """Yield the estimates in a diagnosis from which a wheel's trends are found, one for each part of its friction."""
    stds = {"dry": diagnosis.friction.base_dry.std, "viscous": diagnosis.friction.viscous.std}
    for name, anomaly in diagnosis.anomalies.items():
        yield EstimateRecord(
            window_start_ns=diagnosis.window_start_ns,
            window_end_ns=diagnosis.window_end_ns,
            value=anomaly.estimate,
            std=stds.get(name),
            name=name,
            **anomaly.model_dump(exclude={"estimate", "severity_std"}),
        )


class CoefficientTrend(NamedTuple):
    """The trend of one coefficient.

    Attributes
    ----------
    name, unit
        `dry` or `viscous`; SI unit.
    trend
        The fitted trend; times from the begin of the first window.
    limit
        The limit to which it is extrapolated, None without one.
    reach
        When it is reached, None without a limit.
    """

    name: str
    unit: str
    trend: Trend
    limit: float | None
    reach: Reach | None

    def sentence(self) -> str:
        """Return a sentence on the trend and when it reaches the limit."""
        found, name = self.trend, title(self.name)
        p = f"p < {SMALLEST_P:.0e}" if found.p_value < SMALLEST_P else f"p = {found.p_value:.2g}"
        if not found.present:
            return f"No trend of {name} in {found.windows} windows ({p})."
        per_day, std = (quantity(x * SECONDS_PER_DAY, self.unit) for x in (abs(found.slope), found.slope_std))
        sentence = f"{name} {'grows' if found.slope > 0 else 'falls'} by {per_day} a day (± {std}, {p})"
        return f"{sentence[0].upper()}{sentence[1:]}{self._when()}."

    def _when(self) -> str:
        if self.limit is None or self.reach is None:
            return ""
        limit, now = quantity(self.limit, self.unit), self.trend.lines.now_s
        if self.reach.time_s == now:
            return f" and is beyond its limit of {limit}"
        if not np.isfinite(self.reach.time_s):
            return f" and is far from its limit of {limit}"
        in_days = self.reach.time_s - now >= 2 * SECONDS_PER_DAY
        name, unit_s = ("days", SECONDS_PER_DAY) if in_days else ("hours", SECONDS_PER_HOUR)
        low, median, high = (
            f"{(t - now) / unit_s:.2g}" if np.isfinite(t) else "never"
            for t in (self.reach.low_s, self.reach.time_s, self.reach.high_s)
        )
        return f" and reaches its limit of {limit} in {median} {name} (95 %: {low} to {high})"


def coefficient_trend(
    name: str, estimates: Sequence[EstimateRecord], limit: float | None = None
) -> CoefficientTrend | None:
    """Find the trend of one coefficient of one wheel.

    Parameters
    ----------
    name
        `dry`, `viscous`, or a switching system.
    estimates
        One for each window, in order of time, such as rows of the history.
    limit
        In the estimates' unit; None: the bound of the last window's nominal range that the trend leads to.

    Returns
    -------
    None where fewer than `diagnosis.trend.MIN_WINDOWS` windows have an estimate with a standard deviation.
    """
    if not estimates:
        return None
    first_ns, last = estimates[0].window_start_ns, estimates[-1]
    # Whole nanoseconds first: as floats, times since 1970 would be exact to a quarter of a microsecond only.
    middle_s = [(e.window_start_ns + e.window_end_ns - 2 * first_ns) / 2 / NANOSECONDS_PER_SECOND for e in estimates]
    # An estimate with a standard deviation of zero is left out, as is a missing one.
    std = [e.std if e.std is not None and e.std > 0 else np.nan for e in estimates]
    value = [np.nan if e.value is None else e.value for e in estimates]
    trend = find_trend(np.array(middle_s), np.array(value), np.array(std))
    if trend is None:
        return None
    if limit is None:
        limit = last.nominal_high if trend.slope > 0 else last.nominal_low
    return CoefficientTrend(name, last.unit, trend, limit, None if limit is None else trend.reach(limit))


def wheel_trends(
    windows: Iterable[Diagnosis], limits: Mapping[str, float] | None = None
) -> dict[str, CoefficientTrend]:
    """Find the trends of base dry and viscous friction over the windows of one wheel.

    Parameters
    ----------
    windows
        Diagnoses of one wheel, in any order.
    limits
        By coefficient, `dry` [N m] and `viscous` [N m s/rad]; the others are extrapolated to their nominal range.

    Returns
    -------
    By coefficient, without those that too few windows have an estimate of.
    """
    return friction_trends((estimate for window in windows for estimate in estimates_of(window)), limits)


def friction_trends(
    estimates: Iterable[EstimateRecord], limits: Mapping[str, float] | None = None
) -> dict[str, CoefficientTrend]:
    """Find the trends as `wheel_trends` does, from the estimates of the diagnoses."""
    ordered = sorted(estimates, key=lambda estimate: estimate.window_start_ns)
    found = {}
    for name in RESERVED_ANOMALIES:
        own = [estimate for estimate in ordered if estimate.name == name]
        if trend := coefficient_trend(name, own, (limits or {}).get(name)):
            found[name] = trend
    return found


# ---- one window ------------------------------------------------------------------------------------------------------


VERDICT_STYLE: Final = {"nominal": "bold green", "anomalous": "bold red", "inconclusive": "bold yellow"}
UNKNOWN: Final = "–"


def has_too_few_samples(diagnosis: Diagnosis) -> bool:
    """Return whether too few of a window's slots hold a sample for any part of its friction to be judged."""
    return diagnosis.coverage < MIN_COVERAGE


def render(diagnosis: Diagnosis) -> RenderableType:
    """Return one window's diagnosis for the terminal; only the reason where the window has too few samples."""
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
    """Return the table of possible anomalies, with whether each is active."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 2))
    for column in ("", "anomalous", "probability", "severity", "estimate", "nominal"):
        table.add_column(column, style="" if column else "bold", no_wrap=True)
    for name, anomaly in diagnosis.anomalies.items():
        known = anomaly.nominal_low is not None and anomaly.nominal_high is not None
        table.add_row(
            name,
            _decision(anomaly, diagnosis) if known else Text("not judged"),
            f"{anomaly.probability:.3f}" if known else UNKNOWN,
            _severity(anomaly, decided=diagnosis.verdict != "inconclusive"),
            quantity(anomaly.estimate, anomaly.unit),
            span(anomaly.nominal_low, anomaly.nominal_high, anomaly.unit) if known else UNKNOWN,
        )
    return table


def _decision(anomaly: Anomaly, diagnosis: Diagnosis) -> Text:
    """Return yes, no or undecided for an anomaly; never no under an inconclusive verdict or an inadequate model."""
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
    figures = (measured.value,) if measured.std is None else (measured.value, measured.std)
    return " ± ".join(quantity(figure, measured.unit) for figure in figures)
