"""The fuzzing campaign: fuzzes every reader of outside bytes for a given time, and writes the figures as a page.

    python -m tests.fuzz.campaign [--seconds 600] [--targets csv,mcap] [--page docs/fuzzing.md]

With atheris the search, in each process, is guided by the lines of Python that an input reaches; errors of a target are
kept, counted by their place in the code, and the search continues.
"""

import argparse
import hashlib
import json
import math
import re
import subprocess
import sys
import time
import traceback
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Final

from benchmarks.page import made_at, table

ROOT: Final = Path(__file__).parents[2]
SEED: Final = 20_261_121
MAX_INPUT_BYTES: Final = 100_000
HANG_S: Final = 30
MEMORY_MB: Final = 4_096
MAX_FINDINGS: Final = 50
SLOW_S: Final = 1.0  # an input that takes longer than this, and than all before it, is kept
WATCHED: Final = ("rwa_monitor", "mcap", "tomllib")


class Tally:
    """Counts the runs and errors of a target, and keeps failing inputs, in a file that survives the process."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.executions = self.taken = 0
        self.findings: dict[str, str] = {}
        self.slowest_s = 0.0
        self._written_s = self._begun_s = time.monotonic()

    def run(self, target: Any, run: Any, data: bytes) -> None:
        begun_s = time.monotonic()
        self.executions += 1
        try:
            self.taken += run(target, data)
        except (Exception, RecursionError) as error:  # noqa: BLE001 - the errors that fuzzing looks for
            self._keep(error, data)
        now_s = time.monotonic()
        taken_s = now_s - begun_s
        if taken_s > max(self.slowest_s, SLOW_S):  # perhaps slow by other load: try again
            with suppress(Exception):  # kept above
                run(target, data)
            now_s, taken_s = time.monotonic(), time.monotonic() - now_s
            if taken_s > max(self.slowest_s, SLOW_S):
                (self.folder / f"slow-{hashlib.sha256(data).hexdigest()[:12]}").write_bytes(data)
        self.slowest_s = max(self.slowest_s, taken_s)
        if now_s - self._written_s > 5.0:
            self.write(now_s)

    def _keep(self, error: BaseException, data: bytes) -> None:
        """Keep one input for each place in the code where an error occurs."""
        frames = traceback.extract_tb(error.__traceback__)
        ours = [f"{Path(frame.filename).name}:{frame.lineno}" for frame in frames if "rwa_monitor" in frame.filename]
        what = f"{type(error).__name__} at {(ours or ['the target'])[-1]}"
        if what not in self.findings:
            name = f"finding-{hashlib.sha256(what.encode()).hexdigest()[:12]}"
            (self.folder / name).write_bytes(data)
            text = "".join(traceback.format_exception(error))
            (self.folder / f"{name}.txt").write_text(f"{what}\n{text}", encoding="utf-8", errors="backslashreplace")
            self.findings[what] = name
            self.write(time.monotonic())

    def write(self, now_s: float) -> None:
        """Write the figures."""
        self._written_s = now_s
        figures = {
            "executions": self.executions,
            "taken": self.taken,
            "seconds": now_s - self._begun_s,
            "slowest_s": self.slowest_s,
            "findings": self.findings,
        }
        (self.folder / "figures.json").write_text(json.dumps(figures))


def guided(name: str, folder: Path, seconds: int) -> None:
    """Fuzz one target with atheris; ends the process."""
    import atheris

    with atheris.instrument_imports(include=list(WATCHED)):
        from tests.fuzz.targets import TARGETS, run
    from tests.fuzz.mutation import other_json

    target, tally = TARGETS[name], Tally(folder)
    corpus = folder / "corpus"
    corpus.mkdir(exist_ok=True)
    for number, seed in enumerate(target.seeds()):
        (corpus / f"seed-{number}").write_bytes(seed)
        tally.run(target, run, seed)
    tally.write(time.monotonic())

    def mutate(data: bytes, size: int, number: int) -> bytes:
        other = other_json(data, number) if number % 2 else None
        return other[:size] if other is not None else atheris.Mutate(data, size)

    settings = [f"-max_total_time={seconds}", f"-seed={SEED}", f"-max_len={MAX_INPUT_BYTES}", f"-timeout={HANG_S}"]
    settings += [f"-rss_limit_mb={MEMORY_MB}", f"-artifact_prefix={folder}/", "-print_final_stats=1"]
    settings += ["-keep_seed=1", "-len_control=0"]
    # Values are changed within JSON only where the good inputs are JSON.
    json_mutator = {"custom_mutator": mutate} if any(other_json(seed, 0) for seed in target.seeds()) else {}
    atheris.Setup([sys.argv[0], *settings, str(corpus)], partial(tally.run, target, run), **json_mutator)
    atheris.Fuzz()


def fuzz(name: str, folder: Path, seconds: int) -> dict[str, Any]:
    """Fuzz one target, and return its figures; a process that ends too early is replaced by another."""
    folder.mkdir(parents=True, exist_ok=True)
    results: dict[str, Any] = {"executions": 0, "taken": 0, "seconds": 0.0, "slowest_s": 0.0, "findings": {}}
    while results["seconds"] < 0.9 * seconds and len(results["findings"]) < MAX_FINDINGS:
        status, figures = _one_process(name, folder, math.ceil(seconds - results["seconds"]))
        for key in ("executions", "taken", "seconds"):
            results[key] += figures[key]
        results["slowest_s"] = max(results["slowest_s"], figures["slowest_s"])
        results["findings"] |= figures["findings"]
        # A hang, a crash of native code or too much memory ends the process: that is a finding too.
        if status != 0:
            results["findings"][f"process {len(results['findings'])} ended with {status}"] = "log.txt"
    (folder / "results.json").write_text(json.dumps(results))
    return results


def _one_process(name: str, folder: Path, seconds: int) -> tuple[int, dict[str, Any]]:
    command = [sys.executable, "-m", "tests.fuzz.campaign", "--child", name, "--folder", str(folder)]
    with (folder / "log.txt").open("w") as log:
        child = subprocess.Popen([*command, "--seconds", str(seconds)], cwd=ROOT, stdout=log, stderr=subprocess.STDOUT)
        status = child.wait()
    figures: dict[str, Any] = json.loads((folder / "figures.json").read_text())
    text = (folder / "log.txt").read_text(errors="replace")
    counted = re.findall(r"stat::number_of_executed_units:\s*(\d+)", text)
    figures["executions"] = max([figures["executions"], *map(int, counted)])
    return status, figures


def page(folder: Path, seconds: int) -> str:
    """Return the page with the figures of all targets that have been fuzzed in a folder."""
    rows = []
    for path in sorted(folder.glob("*/results.json")):
        f = json.loads(path.read_text())
        share = f"{100 * f['taken'] / max(f['executions'], 1):.1f} %"
        figures = f"{f['executions']:,}", f"{f['seconds'] / 60:.1f}", share, f"{f['slowest_s']:.2f}"
        rows.append((f"`{path.parent.name}`", *figures, str(len(f["findings"]))))
    head = (ROOT / "docs" / "fuzzing.md").read_text(encoding="utf-8").split("<!-- figures -->")[0]
    of = table(("target", "executions", "minutes", "taken", "slowest [s]", "findings"), rows)
    return f"{head}<!-- figures -->\natheris, at most {seconds} s for each target, seed {SEED}.\n\n{of}\n"


def main() -> int:
    """Run the campaign; 1 if it found something."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--targets", default="")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "fuzz")
    parser.add_argument("--page", type=Path)
    parser.add_argument("--child")
    given = parser.parse_args()
    if given.child:
        guided(given.child, given.folder, given.seconds)
        return 0
    from tests.fuzz.targets import TARGETS

    results = {}
    for name in given.targets.split(",") if given.targets else TARGETS:
        results[name] = fuzz(name, given.folder / name, given.seconds)
        told = {key: value for key, value in results[name].items() if key != "findings"}
        print(name, json.dumps(told), results[name]["findings"] or "nothing found", flush=True)
    if given.page:
        given.page.write_text(page(given.folder, given.seconds) + made_at(), encoding="utf-8")
    return 1 if any(figures["findings"] for figures in results.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
