"""The fault campaign: `make faults`, or `python -m tests.faults.campaign --histories N --seed S --jobs J`.

One history again, with what its processes logged: `--only NUMBER`.
"""

from __future__ import annotations

import argparse
import os
import sys
import textwrap
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from statistics import median

from benchmarks.page import page, put_out, table
from tests.faults.history import LOSING, RECOVERABLE, WINDOW
from tests.faults.trial import Outcome, losing, run_trial

DEVELOPMENT_SEED = 6
ABOUT = {
    "kill_monitor": "the monitor is killed (SIGKILL) at any moment and started again",
    "restart_monitor": "the monitor is stopped in order (SIGTERM) and started again",
    "pause_monitor": "the monitor stands still (SIGSTOP) for up to 1.6 s, longer than the lease of its connection",
    "kill_router": "the router is killed and started again",
    "cut_link": "the connection between monitor and router is cut, messages flow on, it heals",
    "freeze_link": "nothing passes on that connection for a while, and it stays open",
    "restart_publisher": "the publisher, all of whose samples are on the disk, is killed, and another takes its place",
    "rotation": "recordings end as soon as they may, one after the other",
    "duplicate": "messages are sent twice",
    "reorder": "messages overtake each other",
    "corrupt": "damaged messages that cannot be read",
    "second_publisher": "a second publisher publishes on the same wheel while the first one lives",
    "disk_full": "the disk of the recordings is full to the last byte, then free again",
    "disk_fails": "writing to the recording fails (RLIMIT_FSIZE), then works again",
    "clock_step": "the wheel's clock steps by more than a window, forwards or back",
    "wild_times": "single samples with a wild time",
    "bad_data": "a sensor that hangs, spikes, a wrong unit, dropouts, values not measured, flipped bits of values",
    "second_wheel": "a second wheel appears and vanishes",
    "outage_beyond_history": "an outage that lasts longer than the publisher's history (loses samples)",
    "publisher_dies_in_outage": "the publisher and its history die during an outage (loses samples)",
    "flipped_recording": "the monitor is killed; a bit of its recording flips before it starts again (loses samples)",
}

HOW = f"""
Each history is made of (seed, number) alone: simulated telemetry of one or two wheels with windows of {WINDOW:,} slots,
cut into messages, and one to five kinds of faults. It happens to real processes (router, publisher, monitor) over TCP
on loopback. Afterwards the account adds up in every status, on the bus and in the recording; the diagnoses are, byte
for byte, those of `diagnose` on what was sent; each stands once in the chain of recordings, in order, and was on the
bus at least once; and the chain replays. Where the disk fails the recording may lack diagnoses, the bus may not. Where
history is lost the chain must replay, the loss be reported, and the account add up. The monitor is forked from a
process that has loaded it, to be there in a tenth of a second. The service was mended on histories of the seeds
{DEVELOPMENT_SEED}, 2026, 31, 32 and 45; seeds 46, 47 and 61 came after.
"""

LIMITS = """
## Limits

- What is younger than a second is on no disk yet. Where a publisher dies as soon as its samples have arrived, the disk
  fails, and the monitor is killed, all three within a second, they are lost: 1,050 samples in one history of an earlier
  run. A publisher is therefore killed here only a second after all of its samples have arrived.
- A restart of the publisher is not combined with an outage that loses samples, and a monitor that joins late is not
  asked to miss what it cannot know of.
- Where a bit of a recording flips, what is lost is reported and the other recordings replay; the damaged one may not. A
  diagnosis that survived while its inputs did not is made again when they come again, and stands twice, in the same
  bytes.
- What earlier runs found: on seed 31, 297 of 300 histories kept every promise; two showed the diagnosis that stands
  twice, one messages that waited and were not missed yet; since then both are looked for as in `trial.py`. On seed
  32, 299 of 300: after a clock that stepped back, a history that came again was taken for new (3,147 samples twice, 5
  wrong diagnoses); this was mended, with a test, and that history (122) keeps every promise now.
- On seed 45, 99 of 100: the chain of history 64 replayed equal to 1e-9 relative, and not byte for byte. One number of
  the carried state was not rounded as its file is, which showed where a restart came after such a window; mended, with
  a test (`tests/monitor/test_core.py`).
- A second publisher publishes between two messages of the first one, not in an outage, where it looks like a restart.
- A damaged message is one that cannot be read. A flipped digit is a message: telemetry carries no checksum.
- A disk that hangs, rather than fails, stops the monitor until it goes on; this is not tried.
"""


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
    """Return the figures of a campaign as a page."""
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
    faults = [(kind, str(kinds[kind]), ABOUT[kind]) for kind in (*RECOVERABLE, *LOSING)]
    broken = [f"- history {one.number} ({', '.join(one.kinds)}): {one.problems[0][:200]}" for one in failed]
    return page(
        "Fault campaign",
        textwrap.fill(f"`make faults` ({of})." + HOW, 120),
        table(("", ""), rows),
        table(("fault", "histories", "what happens"), faults),
        "\n".join((LIMITS.strip(), *broken)),
    )


if __name__ == "__main__":
    sys.exit(main())
