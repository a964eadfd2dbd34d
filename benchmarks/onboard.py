"""The monitor alone on a small computer: disk, start, memory, share of one core; `make onboard` writes docs/onboard.md.

The package is built here and installed into a fresh environment with the packages of requirements-monitor.txt: no web,
no database, no build tools, no training. There it replays a reference and diagnoses a table of samples.
Then it serves the four wheels of a satellite, pinned to one core (`taskset`) and with its data limited (RLIMIT_DATA:
what the process may write to), while this process publishes 8 samples a second of each wheel over TCP.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Event

import numpy as np

from benchmarks.machine import machine_in_words
from benchmarks.page import add_output_option, page, put_out, table
from benchmarks.speed.live import free_endpoint, samples_of
from benchmarks.window import window_of
from rwa_monitor.monitor.bus import BusOptions, SamplesPublisher, open_session
from rwa_monitor.simulation.datasets import generate

WHEELS = 4
RATE_HZ = 8
FAST_BATCH = 256
WINDOW = 80_000
PATIENCE_S = 900.0  # timeout, for a heavily loaded machine
LIMITS_MB = (128, 192, 256, 384, 512, 768)
ROOT = Path(__file__).parents[1]


@dataclass
class Measured:
    """Measured figures; seconds, megabytes, shares of a core."""

    disk_MB: float
    largest: dict[str, float]
    help_s: float
    first_start_s: float
    start_s: float
    limit_MB: int
    share_of_core: float
    resident_MB: float
    resident_full_MB: float
    threads: int
    fast_samples_s: float


class Service:
    """`rwa-monitor run` of the fresh environment, pinned to one core, with limited memory."""

    def __init__(self, environment: Path, folder: Path, limit_MB: int) -> None:
        self.endpoint = free_endpoint()
        command = [str(environment / "bin/rwa-monitor"), "run", "-l", self.endpoint, "--record", str(folder)]
        if shutil.which("taskset"):
            command = ["taskset", "-c", str(max(os.sched_getaffinity(0))), *command]
        self.log = folder.with_suffix(".log")
        limit = limit_MB * 10**6
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                command,
                stderr=log,
                env={"PATH": os.environ["PATH"]},
                preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (limit, limit)),  # noqa: PLW1509
            )
        self.session = None
        while "monitoring" not in self.log.read_text():
            if self.process.poll() is not None:
                raise MemoryError(self.log.read_text()[-500:])
            Event().wait(0.02)
        self.start_s = self.cpu_s()

    def status(self) -> dict[str, str]:
        """Return the fields of the process's status."""
        lines = Path(f"/proc/{self.process.pid}/status").read_text().splitlines()
        return {name: value.strip() for name, _, value in (line.partition(":") for line in lines)}

    def resident_MB(self) -> float:
        """Return the resident memory."""
        return int(self.status()["VmRSS"].split()[0]) * 1024 / 1e6

    def cpu_s(self) -> float:
        """Return the processor time so far."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def stop(self) -> None:
        """Stop the process."""
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(60.0)


def publish(service: Service, first: int, batches: int, batch: int, pause_s: float) -> int:
    """Publish batches of all wheels; returns the slot after the last. Waits until the monitor has taken them all."""
    window = window_of(next(iter(generate("paper", 1, 1))))
    taken: dict[str, int] = {}
    with open_session(BusOptions(mode="client", connect=(service.endpoint,))) as session:
        session.declare_subscriber(
            "rwa/onboard/*/status",
            lambda sample: taken.update({str(sample.key_expr): json.loads(sample.payload.to_bytes())["samples_used"]}),
        )
        publishers = [SamplesPublisher(session, f"rwa/onboard/wheel_{n + 1}/samples") for n in range(WHEELS)]
        begin = time.monotonic()
        for number in range(batches):
            if pause_s:
                Event().wait(max(0.0, begin + number * pause_s - time.monotonic()))
            for publisher in publishers:
                publisher.put(samples_of(window, first + number * batch, batch))
        due = time.monotonic() + PATIENCE_S
        while sum(taken.values()) < WHEELS * (first + batches * batch) and time.monotonic() < due:
            if service.process.poll() is not None:
                raise MemoryError(service.log.read_text()[-500:])
            Event().wait(0.05)
        for publisher in publishers:
            publisher.close()
    return first + batches * batch


def measure(seconds: float) -> Measured:
    """Measure everything."""
    with tempfile.TemporaryDirectory(prefix="rwa-onboard-") as name:
        folder = Path(name)
        environment = install(folder)
        packages = next((environment / "lib").iterdir()) / "site-packages"
        sizes = {path.name: _size_MB(path) for path in packages.iterdir() if not path.name.startswith(("pip", "setup"))}
        help_s = min(_seconds([str(environment / "bin/rwa-monitor"), "--help"]) for _ in range(5))
        _try_commands(environment, folder)
        first = Service(environment, folder / "first", LIMITS_MB[-1])
        first.stop()
        limit_MB, fast, full = _least_limit(environment, folder)
        service = Service(environment, folder / "slow", limit_MB)
        try:
            slot = publish(service, 0, 4, RATE_HZ, 1.0)  # the first status has been published
            begin_s, cpu_s = time.monotonic(), service.cpu_s()
            publish(service, slot, int(seconds), RATE_HZ, 1.0)
            share = (service.cpu_s() - cpu_s) / (time.monotonic() - begin_s)
            resident, threads = service.resident_MB(), int(service.status()["Threads"])
        finally:
            service.stop()
    largest = dict(sorted(sizes.items(), key=lambda item: -item[1])[:8])
    return Measured(
        disk_MB=sum(sizes.values()),
        largest=largest,
        help_s=help_s,
        first_start_s=first.start_s,
        start_s=service.start_s,
        limit_MB=limit_MB,
        share_of_core=share,
        resident_MB=resident,
        resident_full_MB=full,
        threads=threads,
        fast_samples_s=fast,
    )


def install(folder: Path) -> Path:
    """Build the package and install it, with the monitor's requirements, into a fresh environment."""
    where = f"-Cbuild-dir={folder / 'build'}"
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", where, "-o", str(folder), str(ROOT)]
    subprocess.run(build, check=True, capture_output=True)
    environment = folder / "environment"
    subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True, capture_output=True)
    (package,) = folder.glob("*.whl")
    for what in (["--require-hashes", "-r", str(ROOT / "requirements-monitor.txt")], ["--no-deps", str(package)]):
        install_it = [str(environment / "bin/pip"), "install", "--quiet", *what]
        subprocess.run(install_it, check=True, capture_output=True)
    return environment


def _try_commands(environment: Path, folder: Path) -> None:
    """Run the commands that the page claims to work in this installation; an error ends the benchmark."""
    make_it = ["simulate", "dataset", "--recipe", "paper", "--count", "1", "--format", "csv", "-o", str(folder / "set")]
    program = str(environment / "bin/rwa-monitor")
    for command in (
        [sys.executable, "-m", "rwa_monitor", *make_it],  # with the full installation: the truth is a Parquet file
        [program, "diagnose", str(folder / "set/paper_00000.csv")],
        [program, "replay", "--verify", str(ROOT / "replay/nominal")],
    ):
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env={"PATH": os.environ["PATH"]})


def _least_limit(environment: Path, folder: Path) -> tuple[int, float, float]:
    """Return the least limit under which all wheels fill and diagnose a window, the sample rate, and the memory."""
    for limit_MB in LIMITS_MB:
        try:
            service = Service(environment, folder / f"limit_{limit_MB}", limit_MB)
            try:
                slot = publish(service, 0, 1, FAST_BATCH, 0.0)
                begin_s = time.monotonic()
                end = publish(service, slot, WINDOW // FAST_BATCH + 1, FAST_BATCH, 0.0)
                rate = WHEELS * (end - slot) / (time.monotonic() - begin_s)
                return limit_MB, rate, service.resident_MB()
            finally:
                service.stop()
        except MemoryError as error:
            print(f"{limit_MB} MB are not enough: {str(error).strip().splitlines()[-1:]}", file=sys.stderr)
    raise MemoryError(f"{LIMITS_MB[-1]} MB are not enough")


def _seconds(command: list[str]) -> float:
    """Return the processor time of a command: on an otherwise idle machine, its duration."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env={"PATH": os.environ["PATH"]})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _size_MB(path: Path) -> float:
    files = path.rglob("*") if path.is_dir() else [path]
    return float(np.sum([file.lstat().st_blocks * 512 for file in files if file.is_file()])) / 1e6


def to_markdown(measured: Measured, seconds: float) -> str:
    """Write docs/onboard.md."""
    rows = [
        ["disk", f"{measured.disk_MB:.0f} MB", "330 MB"],
        ["`rwa-monitor --help`, processor time", f"{measured.help_s:.2f} s", ""],
        ["first start until it monitors, processor time", f"{measured.first_start_s:.2f} s", "1.0 s"],
        ["any other start, processor time", f"{measured.start_s:.2f} s", "1.0 s"],
        [
            f"share of one core, {WHEELS} wheels at {RATE_HZ} Hz, a message a second each",
            f"{measured.share_of_core:.1%}",
            "",
        ],
        ["resident memory, windows begun", f"{measured.resident_MB:.0f} MB", "110 MB"],
        ["resident memory after a window of 80,000 slots of each wheel", f"{measured.resident_full_MB:.0f} MB", ""],
        ["least limit of data with which that worked, of those tried", f"{measured.limit_MB} MB", ""],
        ["threads", f"{measured.threads}", ""],
        [f"samples a second, as fast as they come ({FAST_BATCH} in a message)", f"{measured.fast_samples_s:,.0f}", ""],
    ]
    tried, slow = ", ".join(str(limit) for limit in LIMITS_MB), 10.0 * measured.share_of_core
    largest = [[f"`{name}`", f"{size:.0f} MB"] for name, size in measured.largest.items()]
    return page(
        "The monitor alone, on a small computer",
        f"""Made by `make onboard` ({seconds:.0f} s at {RATE_HZ} Hz) on: {machine_in_words()}.

A wheel that was built elsewhere is installed into a fresh environment beside the packages that a monitor needs;
`rwa-monitor run` with a recording is pinned to one core and limited in the data that it may write to, and serves
{WHEELS} wheels over TCP. Limits tried: {tried} MB. A slower core takes more of itself in proportion: one of a tenth of
this one's speed would be busy for {slow:.1%} of its time. For a flight computer without Python there is stage 1 alone,
as a static library in the caller's memory: [export](export.md).

{table(["what", "figure", "at most"], rows)}

## How to install it

On any machine with a C++ compiler and the same processor family and Python as on board, from a checkout (the build
backend is in the lock, too):

```sh
python3 -m venv core
core/bin/pip install --require-hashes -r requirements-core.txt
core/bin/pip wheel --no-deps --no-build-isolation --wheel-dir dist .
```

On board, without a compiler; every package is checked by its hash, and nothing is fetched past the lock:

```sh
python3 -m venv monitor
monitor/bin/pip install --require-hashes -r requirements-monitor.txt
monitor/bin/pip install --no-deps --no-build-isolation dist/rwa_monitor-*.whl
monitor/bin/rwa-monitor doctor
```

Where the computer on board reaches no package index, `pip download --require-hashes -r requirements-monitor.txt -d
wheels` fetches the packages, and `--no-index --find-links wheels` installs them. As a service of systemd, with what it
may touch: `docker/rwa-monitor.service`.

## What it leaves out

`run`, `replay`, `diagnose` of CSV, `doctor` and whatever else needs only these packages work as everywhere. Not there,
and so named by the command that needs it:

- the compiler and what builds the kernels (CMake, Ninja, nanobind, scikit-build-core): the wheel holds them compiled;
- scikit-learn, for `train`; joblib, for many recordings side by side; Jinja2, for the pages of `discrepancy`;
- all extras: web page, database, Parquet, plots, CCSDS and ROS 2.

`pip check` names the three packages of the second line as missing. Recordings made on board are read by the full
installation on the ground, where `train`, `identify` and `discrepancy` belong.

## Processors

`make wheels` compiles the kernels for x86_64 and aarch64 on one machine, without a warning; the wheels demand glibc
2.35 (manylinux_2_35). The reference recordings were replayed with the aarch64 wheel under emulation (qemu-user 7.2,
Python 3.11.2 of Debian 12, numpy 2.4.6, scipy 1.17.1), not on hardware: `rwa-monitor replay --verify` reports all
four equal to 1e-9 relative, `dry` byte for byte. In each of the others one diagnosis differs, elsewhere no byte does:

| recording | field | relative difference |
| --- | --- | --- |
| `nominal` | probability of viscous | 1.4e-16 |
| `two_anomalies` | probability of dry | 1.5e-16 |
| `bad_day` | probability of dry | 1.7e-16 |
| `bad_day` | probability of fss_2 | 1.8e-15 |

The first three are numpy's exponential, which rounds otherwise with AVX-512: x86_64 without it gives the same three.
The fourth stays with the same exponential; of the C library's functions, `hypot` and `erfc` round otherwise on aarch64.

## What the disk holds

{table(["package", "size"], largest)}""",
    )


def main() -> int:
    """Measure, write the page, return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="how long at 8 Hz")
    add_output_option(parser)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    measured = measure(arguments.seconds)
    put_out(to_markdown(measured, arguments.seconds), arguments.output)
    if arguments.json:
        arguments.json.write_text(json.dumps(asdict(measured), indent=1) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
