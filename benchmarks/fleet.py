"""How diagnosis of many recordings scales with workers, and how much memory each uses: `python -m benchmarks.fleet`.

Simulates recordings of one window of 80,000 samples, diagnoses them on 1, 2 and 4 processes, but on no more than
there are cores, and writes docs/fleet.md. Making a recording takes several times as long as diagnosing it: all are made
first, on all cores. Efficiency is the time with one process over n times the time with n. The processes are started
before timing begins, since a fleet of thousands of recordings starts them once. The page also gives processor times,
which other programs on the machine hardly change.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks.machine import describe_machine, peak_memory_bytes
from benchmarks.page import add_output_option, page, put_out, table
from rwa_monitor.batch.tasks import Diagnose, map_files
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.telemetry.table import table_writer
from rwa_monitor.threads import cores
from rwa_monitor.wheel.wheel import built_in_wheel

WORKERS = (1, 2, 4)


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=500)
    parser.add_argument("--repeats", type=int, default=2)
    here = [workers for workers in WORKERS if workers <= cores()]
    parser.add_argument("--workers", type=int, nargs="+", default=here, help="1 and others; %(default)s here")
    add_output_option(parser)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        files = _recordings(Path(folder), options.recordings)
        few = _measure(files[: options.recordings // 4], max(options.workers), 1)  # first: the peak never decreases
        measured = {workers: _measure(files, workers, options.repeats) for workers in options.workers}
    put_out(to_markdown(measured, few, options.recordings), options.output)


def _recordings(folder: Path, count: int) -> list[Path]:
    """Make the recordings, in one process for each core; the processes end afterwards."""
    with ProcessPoolExecutor(cores(), mp_context=get_context("spawn")) as pool:
        return list(pool.map(partial(_recording, folder), range(count), chunksize=10))


def _recording(folder: Path, seed: int) -> Path:
    file = folder / f"wheel_{seed:04d}.parquet"
    table_writer(file)(simulate(Scenario(), built_in_wheel(), np.random.default_rng(seed)).samples, file)
    return file


def _measure(files: list[Path], workers: int, repeats: int) -> dict[str, Any]:
    """Return the seconds of each repeat, the peak memory [MB] of a worker, and processor times per recording [ms]."""
    list(map_files(Diagnose(), files[: 2 * workers], workers=workers))  # starts the workers and their imports
    seconds = []
    before, own = _worker_s(workers), time.process_time()
    for _ in range(repeats):
        began = time.perf_counter()
        outcomes = list(map_files(Diagnose(), files, workers=workers))
        seconds.append(time.perf_counter() - began)
        assert not any(outcome.error for outcome in outcomes)
    own = time.process_time() - own
    each_ms = 1e3 / (repeats * len(files))
    worker_ms = (_worker_s(workers) - before) * each_ms
    return {
        "seconds": seconds,
        "peak_MB": max(peak_memory_bytes(worker.pid) for worker in _workers(workers)) / 1e6,
        "worker_ms": worker_ms,
        "around_ms": own * each_ms if workers > 1 else 0.0,
    }


def _workers(workers: int) -> list[psutil.Process]:
    """Return the worker processes; a single worker is this process."""
    this = psutil.Process()
    return (
        [this]
        if workers == 1
        else [child for child in this.children() if any("popen_loky" in w for w in child.cmdline())]
    )


def _worker_s(workers: int) -> float:
    """Return the processor time of all workers so far [s]."""
    return float(sum(used.user + used.system for used in (worker.cpu_times() for worker in _workers(workers))))


def to_markdown(measured: dict[int, dict[str, Any]], few: dict[str, Any], recordings: int) -> str:
    """Return docs/fleet.md."""
    alone = min(measured[1]["seconds"])
    rows = [
        [
            str(workers),
            f"{min(found['seconds']):.1f} s ({max(found['seconds']):.1f} s)",
            f"{recordings / min(found['seconds']):.1f}",
            f"{alone / workers / min(found['seconds']):.2f}",
            f"{found['worker_ms']:.1f} ms",
            f"{found['around_ms']:.1f} ms",
            f"{found['peak_MB']:.0f} MB",
        ]
        for workers, found in measured.items()
    ]
    head = ["workers", "time", "recordings a second", "efficiency", "worker's ms", "around it, ms"]
    head.append("peak memory of a worker")
    most = measured[max(measured)]
    by_processor = measured[1]["worker_ms"] / (most["worker_ms"] + most["around_ms"])
    unmeasured = "" if 4 in measured else " With 4 it was not measured this time."
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    return page(
        "Many recordings at once",
        f"""<!-- Written by `make fleet`. -->

`diagnose` and `train` work on many recordings at once: in a process for each core, or with
`--scheduler tcp://host:8786` on a Dask cluster that is there (`pip install 'rwa-monitor[fleet]'`).

```sh
rwa-monitor diagnose day/*.parquet --results results --json
rwa-monitor diagnose day/*.parquet --scheduler tcp://scheduler:8786 --results /shared/results
```

- `--results DIR` keeps one Parquet file for each recording (`pip install 'rwa-monitor[parquet]'`). Its name
  holds a hash of recording, settings and release: what is done is not done again, what changed is.
  `rwa_monitor.batch.store.read_results(DIR)` gives all as one table.
- What cannot be used is listed in `DIR/failed.csv` with a reason and stops nothing: bad input, a fault of the
  program, a worker that was killed. The exit code is then 2.
- The lines are those of one recording after the other, byte for byte, in the order of the arguments
  (`tests/cli/test_batch.py`).
- The workers of a scheduler must run the same release and see the files at the same path. Dask's own traffic is not
  protected: a scheduler belongs into a trusted network, or behind TLS (`distributed.comm.tls` in its configuration).

## Measured

{recordings} recordings of 80,000 samples, Parquet, best (worst) of {len(measured[1]["seconds"])} runs,
{describe_machine()["processor"]} ({psutil.cpu_count(logical=False)} physical), load before the run included: {load}.

{table(head, rows)}

The ms are processor time of a recording, the worker's own and that of the process that hands them out.

The target is an efficiency of 0.85 with 4 workers on 4 cores.{unmeasured}

Whatever else the machine does comes off the efficiency by the clock. By the processor times, where the process
that hands out shares the cores with as many workers, it is {by_processor:.2f}: one worker's ms over all ms
with {max(measured)}.

A worker's memory does not grow with the number of recordings: {few["peak_MB"]:.0f} MB after {recordings // 4},
{most["peak_MB"]:.0f} MB after {recordings * len(most["seconds"])}.""",
    )


if __name__ == "__main__":
    main()
