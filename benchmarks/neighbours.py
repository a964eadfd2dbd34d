"""Comparison of a spacecraft's wheels: causes that all wheels share, and a wheel that fails alone.

    python -m benchmarks.neighbours [--spacecraft N] [--seed N] [--jobs N] [-o FILE]

Each spacecraft has four wheels of recipe `mild`, diagnosed window by window into a history. In a third of them
viscous friction, or all friction, of all wheels shifts at once; in a third one wheel's friction grows; a third is
healthy. Each wheel is also taken into a separate history, to measure when its alarm is raised without siblings.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, Literal

import numpy as np

from benchmarks.accuracy.campaign import in_processes
from benchmarks.page import add_output_option, counted, page, put_out, table
from benchmarks.target import at_least, at_most, exit_code, target_table
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.history.alarms import ALL_WHEELS
from rwa_monitor.history.store import History
from rwa_monitor.messages import Diagnosis
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.simulation.datasets import FLEET_SEVERITIES, RECIPES, Recipe, wheel_windows
from rwa_monitor.simulation.scenario import Anomaly, Scenario
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.wheel import Wheel

SEED: Final = 33071
WHEELS: Final = 4
WINDOWS: Final = 24
ONSET: Final = 10  # windows before the change begins
SHIFTS: Final = (0.08, 0.20)  # relative change by a shared cause, up or down
SOON: Final = 4  # windows within which a shared cause is to be named

Kind = Literal["shared", "alone", "healthy"]
KINDS: Final[tuple[Kind, ...]] = ("shared", "alone", "healthy")


@dataclass(frozen=True, slots=True)
class Fate:
    """The fault of a spacecraft's wheels.

    Attributes
    ----------
    kind
        A cause that all wheels share, one wheel that fails, or no fault.
    factors
        By anomaly: the factor on the friction of the affected wheels.
    failing
        Number of the wheel that fails.
    """

    kind: Kind
    factors: dict[str, float]
    failing: int

    @classmethod
    def draw(cls, number: int, seed: int) -> Fate:
        """Draw the fault of a spacecraft."""
        kind, rng = KINDS[number % len(KINDS)], np.random.default_rng([seed, number])
        failing = int(rng.integers(WHEELS))
        if kind == "alone":
            name = str(rng.choice(["dry", "viscous"]))
            return cls(kind, {name: FLEET_SEVERITIES[name]}, failing)
        factor = 1.0 + float(rng.choice([-1.0, 1.0]) * rng.uniform(*SHIFTS))
        names = ("viscous",) if rng.random() < 0.5 else ("dry", "viscous")
        return cls(kind, dict.fromkeys(names, factor) if kind == "shared" else {}, failing)

    def scenario(self, hit: bool, wheel: Wheel, number: int, windows: int, rng: np.random.Generator) -> Scenario:
        """Return the scenario of a wheel, affected (`hit`) or not."""
        healthy = RECIPES["mild"].scenario(wheel, number, windows, rng).model_copy(update={"anomalies": {}})
        window_s = wheel.window.samples * wheel.sample_period_s
        growth_s = (windows - ONSET) * window_s if self.kind == "alone" else 0.0
        anomalies = {
            name: Anomaly(factor=factor, onset_s=ONSET * window_s, growth_s=growth_s)
            for name, factor in self.factors.items()
        }
        return healthy.model_copy(update={"anomalies": anomalies}) if hit else healthy


def _life(fate: Fate, number: int, wheel: int, seed: int) -> list[Diagnosis]:
    """Return the diagnoses of one wheel."""
    hit = fate.kind == "shared" or (fate.kind == "alone" and wheel == fate.failing)
    recipe = Recipe("siblings", RECIPES["mild"].wheel, partial(fate.scenario, hit), WINDOWS)
    state, found = CarriedState.empty(), []
    for window in wheel_windows(recipe, number * WHEELS + wheel, seed):
        (closed,) = diagnose_samples(window.telemetry.samples, window.wheel, built_in_model(), carried=state)
        state = closed.carried
        found.append(closed.message("sat", f"wheel_{wheel}"))
    return found


def _raised(lives: Sequence[Sequence[Diagnosis]]) -> dict[tuple[str, str], int]:
    """Return the window of the first alarm by wheel and anomaly."""
    raised: dict[tuple[str, str], int] = {}
    with TemporaryDirectory() as folder, History(Path(folder, "h.sqlite3")) as history:
        for window, diagnoses in enumerate(zip(*lives, strict=True)):
            for diagnosis in diagnoses:
                _, changed = history.add(diagnosis)
                for alarm in changed:
                    raised.setdefault((alarm.wheel, alarm.name), window)
    return raised


@dataclass(frozen=True, slots=True)
class Seen:
    """First alarms in the history of a spacecraft; windows are numbered from the beginning.

    Attributes
    ----------
    fate
        The fault.
    together, by_itself
        By wheel and anomaly, the window of the first alarm: in a common history, and in a separate one of each wheel.
    """

    fate: Fate
    together: dict[tuple[str, str], int]
    by_itself: dict[tuple[str, str], int]

    @property
    def named(self) -> bool:
        """Whether a shared cause is named within `SOON` windows, and no alarm names a single wheel."""
        shared = [window for (wheel, _), window in self.together.items() if wheel == ALL_WHEELS]
        return bool(shared) and ONSET <= min(shared) < ONSET + SOON and len(shared) == len(self.together)

    def first_of_failing(self, raised: dict[tuple[str, str], int]) -> int:
        """Return the window of the first alarm of the failing wheel's anomaly; `WINDOWS` where there is none."""
        (name,) = self.fate.factors
        return raised.get((f"wheel_{self.fate.failing}", name), WINDOWS)


def look_at(seed: int, number: int) -> Seen:
    """Simulate one spacecraft and take its wheels into histories."""
    fate = Fate.draw(number, seed)
    lives = [_life(fate, number, wheel, seed) for wheel in range(WHEELS)]
    by_itself = {key: window for life in lives for key, window in _raised([life]).items()}
    return Seen(fate, _raised(lives), by_itself)


def to_markdown(seen: Sequence[Seen], seed: int) -> tuple[str, int]:
    """Return the page and the exit code."""
    of = {kind: [one for one in seen if one.fate.kind == kind] for kind in KINDS}
    named = sum(one.named for one in of["shared"])
    earlier = [one.first_of_failing(one.by_itself) - one.first_of_failing(one.together) for one in of["alone"]]
    found = sum(one.first_of_failing(one.together) < WINDOWS for one in of["alone"])
    blamed = [sum(wheel != f"wheel_{one.fate.failing}" for wheel, _ in one.together) for one in of["alone"]]
    alarmed = sum(bool(one.together) for one in of["healthy"])
    alarmed_alone = sum(bool(one.by_itself) for one in of["healthy"])
    median = float(np.median(earlier))
    targets = [
        at_least("shared causes named, no wheel blamed", named / len(of["shared"]), 0.95),
        at_least("failing wheel: windows earlier than alone, median", median, 1.0),
        at_most("healthy spacecraft with an alarm", alarmed / len(of["healthy"]), 0.02),
    ]
    rows = [
        (
            "shared cause",
            counted(named, len(of["shared"])),
            "named for the spacecraft within 4 windows, and no wheel by itself",
        ),
        (
            "the same without siblings",
            str(sum(len({wheel for wheel, _ in one.by_itself}) for one in of["shared"])),
            f"wheels with an alarm of their own, of {WHEELS * len(of['shared'])}",
        ),
        ("failing wheel", counted(found, len(of["alone"])), "alarm of that wheel"),
        (
            "",
            f"{median:g} ({np.quantile(earlier, 0.1):g} to {np.quantile(earlier, 0.9):g})",
            "windows earlier than without siblings, median (10 to 90 %)",
        ),
        ("", str(sum(blamed)), "alarms of other wheels or of all"),
        ("healthy", counted(alarmed, len(of["healthy"])), "spacecraft with any alarm"),
        ("", counted(alarmed_alone, len(of["healthy"])), "the same without siblings"),
    ]
    text = page(
        "Wheels beside each other",
        f"{len(seen)} spacecraft of {WHEELS} wheels, {WINDOWS} windows each, seed {seed}. Shared causes shift viscous "
        f"friction, or all friction, of all wheels by {100 * SHIFTS[0]:.0f} to {100 * SHIFTS[1]:.0f} % after "
        f"{ONSET} windows; a failing wheel's dry or viscous friction grows from there on to "
        f"+{100 * (FLEET_SEVERITIES['dry'] - 1):.0f} % or +{100 * (FLEET_SEVERITIES['viscous'] - 1):.0f} %.",
        target_table(targets),
        table(("spacecraft", "", "what"), rows),
    )
    return text, exit_code(targets)


def main() -> int:
    """Measure, write the page, return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spacecraft", type=int, default=120, help="a third of each kind (default %(default)s)")
    parser.add_argument("--seed", type=int, default=SEED, help="(default %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default %(default)s)")
    add_output_option(parser)
    options = parser.parse_args()
    seen = list(in_processes(partial(look_at, options.seed), range(options.spacecraft), options.jobs))
    text, code = to_markdown(seen, options.seed)
    put_out(text, options.output)
    return code


if __name__ == "__main__":
    sys.exit(main())
