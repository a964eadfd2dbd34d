"""Estimate of the resources for thousands of satellites: `make scale` computes docs/scale.md from docs/speed.json.

Measured figures come from the speed benchmark's results; assumptions are in `Assumptions` and on the page.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import dataclass
from pathlib import Path

from benchmarks.page import add_output_option, page, put_out, table
from benchmarks.speed.live import BATCH
from benchmarks.speed.report import SpeedReport

DOCS = Path(__file__).parents[1] / "docs"
FLEETS = (10, 1_000, 100_000)
DAY_S = 86_400.0
MONTH_S = 30.4 * DAY_S


@dataclass(frozen=True)
class Assumptions:
    """Quantities that are not measured here."""

    wheels: int = 4  # per satellite: three and a spare
    rate_Hz: float = 8.0
    message_bytes: float = 15_000.0  # JSON of a message of 256 samples with time, speed and friction (facts of the bus)
    recorded_share: float = 0.35  # of it that remains in the recording after zstd: random digits compress no further
    headroom: float = 0.5  # planned load of a core; the rest is for catching up after an outage
    window_slots: int = 80_000
    core_GB: float = 4.0  # memory included with a rented core
    core_month: float = 25.0  # EUR a month for the core
    gigabyte_month: float = 0.02  # EUR a month for a gigabyte in an object store
    kept_months: float = 12.0
    router_messages_s: float = 200_000.0  # of 1 kB from one process to another on a loopback (facts of the bus)


@dataclass(frozen=True)
class Costs:
    """Measured costs: seconds of processor time and bytes."""

    sample_s: float
    pipe_samples_s: float
    close_s: float
    wheel_MB: float


def costs_of(report: SpeedReport) -> Costs:
    """Read the costs out of the benchmark's results."""
    laps = {lap.name: lap for section in report.sections for lap in section.laps}
    figures = {name: value for section in report.sections for name, value in section.figures.items()}
    step = next(lap for name, lap in laps.items() if "batches of" in name)
    reached = {target.name: target.reached for target in report.targets}
    pipe = float(figures["bus → recording, samples a second"])  # type: ignore[arg-type]
    return Costs(
        sample_s=step.median_s / 80_000.0,
        pipe_samples_s=pipe,
        close_s=float(figures["close → diagnosis, median [ms]"]) * 1e-3,  # type: ignore[arg-type]
        wheel_MB=next(value for name, value in reached.items() if "required channels" in name),
    )


def to_markdown(report: SpeedReport, given: Assumptions) -> str:
    """Write docs/scale.md."""
    costs = costs_of(report)
    rows = [row(satellites, costs, given) for satellites in FLEETS]
    head = ["", *(f"{satellites:,} satellites" for satellites in FLEETS)]
    names = (
        "wheels",
        "samples a second",
        "messages a second",
        "bytes a second on the bus",
        "recordings a month",
        "cores for the way from bus to recording, diagnosis included",
        "memory for open windows",
        f"cores to rent, with {given.core_GB:g} GB each",
        "windows diagnosed a day",
        "diagnosing a month again, from recordings, detection and diagnosis alone",
        "processes of at most 4,096 wheels",
        "EUR a month: cores",
        f"EUR a month: recordings of {given.kept_months:.0f} months",
    )
    body = [[name, *(column[place] for column in rows)] for place, name in enumerate(names)]
    share = given.router_messages_s / (given.wheels * given.rate_Hz / BATCH)
    catch_up_h = 1000 * given.wheels * given.rate_Hz * DAY_S / costs.pipe_samples_s / 3600.0
    one_by_one = given.router_messages_s / (given.wheels * given.rate_Hz)
    return page(
        "Ten satellites, a thousand, a hundred thousand",
        f"""Made by `make scale` from the figures of `docs/speed.json` ([Speed](speed.md)), measured on an
{report.machine["processor"]}.

{table(head, body)}

## What is measured

| figure | value |
| --- | --- |
| incremental step, a sample | {1e9 * costs.sample_s:.0f} ns |
| bus → recording, one process | {costs.pipe_samples_s:,.0f} samples a second |
| close → diagnosis of a window | {1e3 * costs.close_s:.1f} ms |
| memory of a wheel with a window of 80,000 | {costs.wheel_MB:.2f} MB |

## What is assumed

{given.wheels} wheels a satellite at {given.rate_Hz:g} Hz; {BATCH} samples in a message of
{given.message_bytes / 1e3:.0f} kB, one in {BATCH / given.rate_Hz:.0f} s, of which {given.recorded_share:.0%} are left
on the disk. Cores planned at {given.headroom:.0%} of their time, at {given.core_month:.0f} EUR a month with
{given.core_GB:g} GB each;
{given.gigabyte_month:g} EUR a month for a gigabyte kept, {given.kept_months:.0f} months of recordings. Prices are
orders of magnitude: put in your own (`Assumptions` in `benchmarks/scale.py`). Downlink is not counted: telemetry comes
anyway.

## The first bottleneck, and what to change there

**Up to some {4096 // given.wheels:,} satellites: none.** One process serves them; its limit is memory
({costs.wheel_MB:.1f} MB a wheel, 4,096 wheels), not the processor.

**A thousand: memory, and the time to catch up.** The processor is idle; after an outage of a day one core takes
{catch_up_h:.1f} h for what has gathered. A monitor for each quarter of the fleet (`run --shard 1/4` … `4/4`) makes it a
quarter. Publishers must keep the outage in their history.
Each recording holds a checkpoint of each wheel, 1.7 MB where a window of 80,000 slots is nearly full, so that a
restart needs no other file: of a thousand wheels 1.7 GB. They are written while messages go on ([a fleet
live](fleet_live.md)); a restart reads and writes them once more ([restart](restart.md)). Shards make that shorter, too.

**A hundred thousand: the disk, then memory, then the router.** {rows[-1][4]} of recordings a month cost more than
the cores. Delta coding of the arrays, or binary messages instead of JSON, would cut them by about three, and the
reading of JSON with them; keeping samples for weeks and diagnoses for good cuts them by ten. Cores are rented for
their memory, of which open windows hold {rows[-1][6]}: shorter windows (`window.samples`) take less in proportion.
One router passes on some {given.router_messages_s:,.0f} small messages a second: of {share:,.0f} satellites at
{BATCH} samples a message, but of only {one_by_one:,.0f} at one sample a message. Beyond, one router for each group of
shards: monitors share nothing, so a fleet splits by key expression (`run --wheels`) without loss.

**The overview page** holds at most 5,000 wheels (`dashboard`): above, one dashboard for each group.""",
    )


def row(satellites: int, costs: Costs, given: Assumptions) -> list[str]:
    """Return one column of the table."""
    wheels = satellites * given.wheels
    samples_s = wheels * given.rate_Hz
    bytes_s = samples_s / BATCH * given.message_bytes
    kept = bytes_s * given.recorded_share * MONTH_S
    cores = samples_s / costs.pipe_samples_s / given.headroom
    memory_GB = wheels * costs.wheel_MB / 1e3
    rented = math.ceil(max(cores, memory_GB / given.core_GB))
    windows = samples_s * DAY_S / given.window_slots
    again_h = samples_s * MONTH_S * (costs.sample_s + costs.close_s / given.window_slots) / 3600.0
    return [
        f"{wheels:,}",
        f"{samples_s:,.0f}",
        f"{samples_s / BATCH:,.1f}",
        _bytes(bytes_s),
        _bytes(kept),
        f"{cores:.2g}",
        _bytes(memory_GB * 1e9),
        f"{rented:,}",
        f"{windows:,.0f}",
        f"{again_h:,.1f} core hours",
        f"{-(-wheels // 4_096)}",
        f"{given.core_month * rented:,.0f}",
        f"{given.gigabyte_month * kept * given.kept_months / 1e9:,.1f}",
    ]


def _bytes(count: float) -> str:
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000.0:
            return f"{count:.3g} {unit}"
        count /= 1000.0
    return f"{count:,.3g} TB"


def main() -> int:
    """Compute and write the page, return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_output_option(parser)
    parser.add_argument("--speed", type=Path, default=DOCS / "speed.json", help="results of the speed benchmark")
    arguments = parser.parse_args()
    text = to_markdown(SpeedReport.from_json(json.loads(arguments.speed.read_text())), Assumptions())
    put_out(text, arguments.output)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
