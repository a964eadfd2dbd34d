"""The fault campaign: `make faults`, or `python -m tests.faults.campaign --histories N --seed S --jobs J`.

One history again, with what its processes logged: `--only NUMBER`.
"""

import argparse
import os
import re
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from statistics import median

from benchmarks.page import put_out, table
from tests.faults.history import LOSING, RECOVERABLE
from tests.faults.trial import Outcome, losing, run_trial

PAGE = Path(__file__).parents[2] / "docs" / "faults.md"
DEVELOPMENT_SEED = 6


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--histories", type=int, default=300)
    parser.add_argument("--first", type=int, default=0, help="number of the first history")
    parser.add_argument("--seed", type=int, default=DEVELOPMENT_SEED)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", type=int, nargs="*", metavar="NUMBER")
    parser.add_argument("-o", "--output", type=Path)
    arguments = parser.parse_args()
    numbers = arguments.only or range(arguments.first, arguments.first + arguments.histories)
    outcomes: list[Outcome] = []
    begin_s = time.monotonic()
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context("spawn")) as pool:
        trial = partial(run_trial, arguments.seed, root=os.geteuid() == 0)
        for future in as_completed([pool.submit(trial, number) for number in numbers]):
            outcomes.append(future.result())
            _tell(outcomes[-1], talk=bool(arguments.only))
    text = report(sorted(outcomes, key=lambda outcome: outcome.number), arguments.seed, time.monotonic() - begin_s)
    put_out(text, arguments.output)
    return 1 if any(outcome.problems for outcome in outcomes) else 0


def _tell(outcome: Outcome, *, talk: bool) -> None:
    kinds = ", ".join(outcome.kinds)
    figures = f"{outcome.sent} sent, {outcome.lost} lost, {outcome.told} messages missed"
    print(f"{outcome.number:4d} {outcome.took_s:5.1f} s {kinds}: {figures}", file=sys.stderr, flush=True)
    for problem in outcome.problems:
        print(f"     PROBLEM {problem}", file=sys.stderr)
    if outcome.problems or talk:
        print(outcome.talk, file=sys.stderr, flush=True)


def report(outcomes: list[Outcome], seed: int, took_s: float) -> str:
    """Return the page with the figures of a campaign; its words are those that stand there."""
    whole = [outcome for outcome in outcomes if not losing(outcome.kinds)]
    less = [outcome for outcome in outcomes if losing(outcome.kinds)]
    kinds = Counter(kind for outcome in outcomes for kind in outcome.kinds)
    failed = [outcome for outcome in outcomes if outcome.problems]
    stops_s = [stop_s for outcome in outcomes for stop_s in outcome.stops_s]
    rows = [
        ("histories", f"{len(outcomes)}"),
        ("with a broken promise", f"{len(failed)}"),
        ("faults", f"{kinds.total()}"),
        ("recordings in all chains, every chain replayed", f"{sum(outcome.recordings for outcome in outcomes)}"),
        ("diagnoses compared", f"{sum(outcome.windows for outcome in outcomes)}"),
        ("wrong, false or missing diagnoses", f"{sum(outcome.wrong for outcome in outcomes)}"),
        ("samples sent, histories that can be recovered", f"{sum(outcome.sent for outcome in whole):,}"),
        ("samples lost of these", f"{sum(outcome.lost for outcome in whole)}"),
        ("samples sent, histories that must lose some", f"{sum(outcome.sent for outcome in less):,}"),
        ("samples lost of these", f"{sum(outcome.lost for outcome in less):,}"),
        ("messages that `status` reports as missing there", f"{sum(outcome.told for outcome in less)}"),
        ("from SIGTERM to the end, median and largest [s]", f"{median(stops_s):.2f}, {max(stops_s):.2f}"),
    ]
    of = f"seed {seed}, histories {outcomes[0].number} to {outcomes[-1].number}, {took_s:.0f} s"
    faults = [(kind, str(kinds[kind]), about) for kind, about in (RECOVERABLE | LOSING).items()]
    broken = [f"- history {one.number} ({', '.join(one.kinds)}): {one.problems[0][:200]}" for one in failed]
    before = PAGE.read_text(encoding="utf-8")
    limits = re.split(r"\n- history |\n\n\*Made by ", before[before.index("## Limits") :])[0]
    return "\n\n".join(
        (
            re.sub(r"\(seed [^)]*\)", f"({of})", before.partition("\n\n| ")[0], count=1),
            table(("", ""), rows),
            table(("fault", "histories", "what happens"), faults),
            "\n".join((limits, *broken, "")),
        )
    )


if __name__ == "__main__":
    sys.exit(main())
