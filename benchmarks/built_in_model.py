"""Rebuilds the model that ships with the package: `make model`, or `python -m benchmarks.built_in_model -o FILE`.

The result is identical on the same machine; elsewhere numbers may differ in the last of their 12 digits.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Final

from benchmarks.accuracy.campaign import outcomes
from rwa_monitor.diagnosis.model import Model
from rwa_monitor.diagnosis.training import train
from rwa_monitor.paper.classification import with_classifiers
from rwa_monitor.wheel.wheel import built_in_wheel

RECIPE: Final = "mild"
WINDOWS: Final = 1000
SEED: Final = 20_260_101
COMMAND: Final = "make model"


def train_built_in_model(workers: int, windows: int = WINDOWS) -> Model:
    """Train the built-in model on simulated windows of the built-in wheel's kind.

    Parameters
    ----------
    workers
        Processes; the result does not depend on it.
    windows
        Number of windows; fewer give a less accurate model, for tests.
    """
    found = list(outcomes(RECIPE, windows, SEED, workers))
    joint, paper = ([outcome.labelled(method) for outcome in found] for method in ("joint", "paper"))
    source = f"recipe {RECIPE}, {windows} windows, seed {SEED}"
    return with_classifiers(train(joint, built_in_wheel(), source=source, command=COMMAND), paper)


def main() -> None:
    """Write the model to the given file."""
    parser = argparse.ArgumentParser(description="Rebuilds the built-in model.")
    parser.add_argument("-o", "--output", type=Path, required=True, help="file to write")
    parser.add_argument("--windows", type=int, default=WINDOWS, help="fewer give a rougher model (default %(default)s)")
    parser.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    arguments = parser.parse_args()
    model = train_built_in_model(arguments.workers, arguments.windows)
    arguments.output.write_text(model.to_json(), encoding="utf-8")
    sys.stderr.write(f"wrote {arguments.output}, sha256 {model.sha256()}\n")


if __name__ == "__main__":
    main()
