"""Accuracy of trends over windows, on simulated lives of wheels of the recipe `fleet`: `make benchmark-trend`.

    python -m benchmarks.trend [--wheels N] [--seed N] [--workers N] [-o FILE]

Each wheel lives for 24 windows, in which one anomaly, or none, begins at a random time and grows to the end. Every
window is diagnosed with the state carried over from earlier ones, and after each the trend is estimated again, as a
monitor does.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from benchmarks.accuracy.campaign import in_processes
from benchmarks.page import NONE, add_output_option, counted, page, put_out, section, table
from rwa_monitor.cli.options import track
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.diagnosis.trend import MIN_WINDOWS, SIGNIFICANCE, find_trend
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.samples import FloatArray
from rwa_monitor.simulation.datasets import FLEET_WINDOWS, LabelledWindow, generate

COEFFICIENTS = ("dry", "viscous")
SHARE = 0.9  # of the final growth: the limit whose crossing time is predicted
LOOKS = (12, 16, 20)  # numbers of windows after which the predictions are judged


@dataclass(frozen=True)
class Life:
    """One wheel: its anomaly, and for each coefficient estimates, deviations and truth, (windows,)."""

    anomaly: str
    onset_s: float
    growth_s: float
    factor: float
    window_s: float
    value: dict[str, FloatArray]
    std: dict[str, FloatArray]
    healthy: dict[str, float]


@dataclass(frozen=True)
class Foretold:
    """One predicted interval: whether it covers the true time, its width and the time to the limit [windows]."""

    held: bool
    width: float
    ahead: float


def live(windows: list[LabelledWindow]) -> Life:
    """Diagnose one wheel's windows one after the other."""
    model, carried, rows = built_in_model(), None, []
    for window in windows:
        (found,) = diagnose_samples(window.telemetry.samples, window.wheel, model, carried=carried)
        carried = found.carried
        rows.append((found.diagnosis.friction.base_dry, found.diagnosis.friction.viscous))
    scenario, truth = windows[0].scenario, windows[0].telemetry.truth
    name, anomaly = next(iter(scenario.anomalies.items()), ("", None))
    return Life(
        anomaly=name,
        onset_s=anomaly.onset_s if anomaly else np.inf,
        growth_s=anomaly.growth_s if anomaly else np.inf,
        factor=anomaly.factor if anomaly else 1.0,
        window_s=windows[0].wheel.window.samples * windows[0].wheel.sample_period_s,
        value={c: np.array([row[i].value for row in rows], dtype=float) for i, c in enumerate(COEFFICIENTS)},
        std={c: np.array([row[i].std for row in rows], dtype=float) for i, c in enumerate(COEFFICIENTS)},
        healthy={"dry": float(truth.base_dry_Nm[0]), "viscous": float(truth.viscous_Nm_s_rad[0])},
    )


def lives(wheels: int, seed: int) -> Iterator[list[LabelledWindow]]:
    """Yield the windows of one wheel after the other."""
    windows = generate("fleet", wheels * FLEET_WINDOWS, seed)
    while life := list(islice(windows, FLEET_WINDOWS)):
        yield life


def judge(life: Life, coefficient: str) -> tuple[int | None, dict[int, Foretold], Foretold | None]:
    """Return the number of windows at the first detected trend, the predictions by that number, and the first one's."""
    middle_s = (np.arange(FLEET_WINDOWS, dtype=np.float64) + 0.5) * life.window_s
    grows = life.anomaly == coefficient
    limit = life.healthy[coefficient] * (1.0 + SHARE * (life.factor - 1.0)) if grows else np.inf
    truth_s = life.onset_s + SHARE * life.growth_s
    first, at_looks, at_first = None, {}, None
    for seen in range(MIN_WINDOWS, FLEET_WINDOWS + 1):
        found = find_trend(middle_s[:seen], life.value[coefficient][:seen], life.std[coefficient][:seen])
        if found is None or not found.present:
            continue
        reach = found.reach(limit) if grows and truth_s > middle_s[seen - 1] and found.value < limit else None
        if reach is not None:
            width, ahead = reach.high_s - reach.low_s, truth_s - middle_s[seen - 1]
            at_looks[seen] = Foretold(
                reach.low_s <= truth_s <= reach.high_s, width / life.window_s, ahead / life.window_s
            )
        if first is None:
            first, at_first = seen, at_looks.get(seen)
    return first, at_looks, at_first


def to_markdown(found: list[Life], command: str) -> str:
    """Write the page."""
    alarms, delays, foretold = [], [], []
    for coefficient in COEFFICIENTS:
        judged = [(life, *judge(life, coefficient)) for life in found]
        without = [first for life, first, *_ in judged if life.anomaly != coefficient]
        alarms.append([coefficient, counted(sum(first is not None for first in without), len(without))])
        growing = [(life, first) for life, first, *_ in judged if life.anomaly == coefficient]
        late = [first - life.onset_s / life.window_s for life, first in growing if first is not None]
        early = sum(first is not None and first < life.onset_s / life.window_s for life, first in growing)
        delay = [f"{np.median(late):.1f}", f"{max(late):.1f}"] if late else [NONE, NONE]
        delays.append([coefficient, counted(len(late), len(growing)), *delay, str(early)])
        groups = {f"after {look} windows": [looks[look] for *_, looks, _ in judged if look in looks] for look in LOOKS}
        groups["when first announced"] = [at_first for *_, at_first in judged if at_first is not None]
        for when, each in groups.items():
            if each:
                ahead, width = (np.median([getattr(one, field) for one in each]) for field in ("ahead", "width"))
                held = counted(sum(one.held for one in each), len(each))
                foretold.append([coefficient, when, held, f"{ahead:.1f}", f"{width:.1f}"])
    introduction = (
        f"Made by `{command}`: {len(found)} wheels of the recipe `fleet`, {FLEET_WINDOWS} windows of 80,000 samples "
        "each, simulated and diagnosed window by window with the state carried on. In one wheel of five nothing "
        "grows; in the others base dry friction, viscous friction or one switching system's, linearly from a "
        f"random time to the end. A trend is looked for after every window from the {MIN_WINDOWS}th, and announced "
        f"where p < {SIGNIFICANCE:g} (`rwa_monitor/diagnosis/trend.py` describes how). Brackets: 95 % intervals."
    )
    return page(
        "Trends over windows",
        introduction,
        section(
            "False alarms",
            "Wheels whose coefficient does not grow, and on which a growth of it was announced at any of the looks of "
            "their whole life:",
            table(["coefficient", "announced"], alarms),
        ),
        section(
            "Growth found",
            "Delay: windows from the beginning of the growth to the announcement.",
            table(["coefficient", "announced", "median delay", "longest", "before it began"], delays),
        ),
        section(
            "Time to a limit",
            f"How often the 95 % interval holds the true time at which {100 * SHARE:.0f} % of the final growth is "
            "reached, and how far off and how wide it was, in windows (median).",
            table(["coefficient", "when", "interval holds the truth", "ahead", "width"], foretold),
        ),
    )


def main() -> None:
    """Diagnose all lives and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wheels", type=int, default=60)
    parser.add_argument("--seed", type=int, default=7_301)
    parser.add_argument("--workers", type=int, default=2)
    add_output_option(parser)
    options = parser.parse_args()
    lives_of = lives(options.wheels, options.seed)
    found = list(track(in_processes(live, lives_of, options.workers), options.wheels, "wheels"))
    text = to_markdown(found, f"python -m benchmarks.trend --wheels {options.wheels} --seed {options.seed}")
    put_out(text, options.output)


if __name__ == "__main__":
    main()
