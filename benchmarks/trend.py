"""Trends over windows, measured on whole lives of wheels of the recipe `fleet`; writes docs/trend.md.

    python benchmarks/trend.py [--wheels N] [--seed N] [--workers N]

Each wheel lives for 24 windows, in which one anomaly, or none, begins at a random time and grows to the end. Every
window is diagnosed with the state that the ones before it left, and after each the trend is looked for anew, as a
monitor does.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import numpy as np  # noqa: E402

from benchmarks.accuracy.page import table  # noqa: E402
from benchmarks.accuracy.splits import wilson  # noqa: E402
from rwa_monitor.diagnosis.model import built_in_model  # noqa: E402
from rwa_monitor.diagnosis.trend import MIN_WINDOWS, SIGNIFICANCE, find_trend  # noqa: E402
from rwa_monitor.live.core import diagnose_samples  # noqa: E402
from rwa_monitor.physics.datasets import FLEET_WINDOWS, LabelledWindow, generate  # noqa: E402

PAGE = Path(__file__).resolve().parent.parent / "docs" / "trend.md"
COEFFICIENTS = ("dry", "viscous")
SHARE = 0.9  # of the final growth: the limit whose time is foretold
LOOKS = (12, 16, 20)  # windows after which the foretold times are judged


@dataclass(frozen=True)
class Life:
    """One wheel: its anomaly, and for each coefficient estimates, deviations and truth, (windows,)."""

    anomaly: str
    onset_s: float
    growth_s: float
    factor: float
    window_s: float
    value: dict[str, np.ndarray]
    std: dict[str, np.ndarray]
    healthy: dict[str, float]


@dataclass(frozen=True)
class Foretold:
    """One interval: whether it held the truth, its width, and how far ahead the limit was, in windows."""

    held: bool
    width: float
    ahead: float


def live(windows: list[LabelledWindow]) -> Life:
    """Diagnose one wheel's windows one after the other."""
    model, carried, rows = built_in_model(), None, []
    for window in windows:
        (found,) = diagnose_samples(window.telemetry.samples, window.wheel, model, carried=carried)
        carried = found.carried
        rows.append((found.diagnosis.base_dry, found.diagnosis.viscous))
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
    """Give the windows of one wheel after the other."""
    windows = generate("fleet", wheels * FLEET_WINDOWS, seed)
    while life := list(islice(windows, FLEET_WINDOWS)):
        yield life


def judge(life: Life, coefficient: str) -> tuple[int | None, dict[int, Foretold], Foretold | None]:
    """Return the window of the first announcement, what was foretold at `LOOKS`, and at the first announcement."""
    middle_s = (np.arange(FLEET_WINDOWS) + 0.5) * life.window_s
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


def rate(count: int, total: int) -> str:
    low, high = wilson(count / total, total) if total else (0.0, 1.0)
    return f"{count} of {total} ({100 * low:.0f}–{100 * high:.0f} %)"


def page(found: list[Life], command: str) -> str:
    """Write the page."""
    alarms, delays, foretold = [], [], []
    for coefficient in COEFFICIENTS:
        judged = [(life, *judge(life, coefficient)) for life in found]
        without = [first for life, first, *_ in judged if life.anomaly != coefficient]
        alarms.append([coefficient, rate(sum(first is not None for first in without), len(without))])
        growing = [(life, first) for life, first, *_ in judged if life.anomaly == coefficient]
        late = [first - life.onset_s / life.window_s for life, first in growing if first is not None]
        early = sum(first is not None and first < life.onset_s / life.window_s for life, first in growing)
        delays.append(
            [coefficient, rate(len(late), len(growing)), f"{np.median(late):.1f}", f"{max(late):.1f}", str(early)]
        )
        groups = {f"after {look} windows": [looks[look] for *_, looks, _ in judged if look in looks] for look in LOOKS}
        groups["when first announced"] = [at_first for *_, at_first in judged if at_first is not None]
        for when, each in groups.items():
            if each:
                ahead, width = (np.median([getattr(one, field) for one in each]) for field in ("ahead", "width"))
                foretold.append(
                    [coefficient, when, rate(sum(one.held for one in each), len(each)), f"{ahead:.1f}", f"{width:.1f}"]
                )
    introduction = (
        f"Made by `{command}`: {len(found)} wheels of the recipe `fleet`, {FLEET_WINDOWS} windows of 80,000 samples "
        "each, simulated and diagnosed window by window with the state carried on. In one wheel of five nothing "
        "grows; in the others base dry friction, viscous friction or one switching system's, linearly from a "
        f"random time to the end. A trend is looked for after every window from the {MIN_WINDOWS}th, and announced "
        f"where p < {SIGNIFICANCE:g} (`rwa_monitor/diagnosis/trend.py` says how). Brackets: 95 % intervals."
    )
    false_alarms = (
        "## False alarms\n\nWheels whose coefficient does not grow, and on which a growth of it was announced at "
        "any of the looks of their whole life:\n\n"
    )
    growth = "## Growth found\n\nDelay: windows from the beginning of the growth to the announcement.\n\n"
    limits = (
        f"## Time to a limit\n\nHow often the 95 % interval holds the true time at which {100 * SHARE:.0f} % of the "
        "final growth is reached, and how far off and how wide it was, in windows (median).\n\n"
    )
    parts = [
        "# Trends over windows",
        introduction,
        false_alarms + table(["coefficient", "announced"], alarms),
        growth + table(["coefficient", "announced", "median delay", "longest", "before it began"], delays),
        limits + table(["coefficient", "when", "interval holds the truth", "ahead", "width"], foretold),
    ]
    return "\n\n".join(parts) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--wheels", type=int, default=60)
    parser.add_argument("--seed", type=int, default=7_001)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    with multiprocessing.get_context("spawn").Pool(options.workers) as pool:
        found = list(pool.imap(live, lives(options.wheels, options.seed)))
    text = page(found, f"python benchmarks/trend.py --wheels {options.wheels} --seed {options.seed}")
    PAGE.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
