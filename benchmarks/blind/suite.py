"""The blind suite: `python -m benchmarks.blind.suite --records N --jobs J --seed S` writes docs/blind.md and a JSON."""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import fields
from multiprocessing import get_context
from pathlib import Path

import rwa_monitor
from benchmarks.blind.formulas import MEAN, OUTSIDE, PAIRS
from benchmarks.blind.generator import NOISE_EFFECTS, SWITCHING_EFFECTS, Case, plan
from benchmarks.blind.table import report
from benchmarks.blind.trial import Outcome, run_trial
from benchmarks.page import made_at

NOTES = Path(__file__).with_name("notes.md")  # explanations that precede the table
PER_EFFECT, NULLS, PER_PAIR, PER_OUTSIDE = 20, 200, 3, 12  # of the full suite


def cases(seed: int) -> list[Case]:
    """Return the plan of the full suite, ordered so that any first part of it is balanced over the hidden effects."""
    groups: list[list[Case]] = [
        [plan("one", (name,), i + k, seed) for i in range(PER_EFFECT)]
        for k, name in enumerate((*MEAN, *NOISE_EFFECTS, *SWITCHING_EFFECTS))
    ]
    groups += [[plan("outside", (name,), i + k, seed) for i in range(PER_OUTSIDE)] for k, name in enumerate(OUTSIDE)]
    groups += [[plan("two", pair, 3 * i + 1 + k % 2, seed) for i in range(PER_PAIR)] for k, pair in enumerate(PAIRS)]
    groups += [[plan("null", (), k + 10 * i, seed + k) for i in range(NULLS // 10)] for k in range(10)]
    return [case for case, _ in _spread(groups)]


def _spread(groups: list[list[Case]]) -> Iterator[tuple[Case, float]]:
    """Yield all cases so that each group advances evenly."""
    places = [
        ((i + 0.5 * (g + 1) / len(groups)) / len(group), case)
        for g, group in enumerate(groups)
        for i, case in enumerate(group)
    ]
    for at, case in sorted(places, key=lambda entry: entry[0]):
        yield case, at


def _run(case: Case, folder: str) -> Outcome:
    return run_trial(case, Path(folder))


def _code() -> str:
    """Return a digest of the code that an outcome depends on: the package and the suite itself."""
    digest = hashlib.sha256()
    for root in (Path(rwa_monitor.__file__).parent, Path(__file__).parent):
        for path in sorted([*root.rglob("*.py"), *root.rglob("*.json")]):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _write(outcomes: list[Outcome], path: Path, code: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [json.dumps({**outcome.to_json(), "code": code}) for outcome in outcomes]
    partial = path.with_suffix(".partial")
    partial.write_text("\n".join(lines) + "\n")
    partial.replace(path)  # atomic: a killed run leaves complete files


def _done_before(path: Path, wanted: list[Case], code: str) -> list[Outcome]:
    """Return the outcomes of an interrupted run of the same plan by the same code."""
    if not path.exists():
        return []
    rows = [json.loads(line) for line in path.read_text().splitlines() if line]
    names = {entry.name for entry in fields(Outcome)}
    before = []
    for row in rows:
        case = Case(**{**row["case"], "effects": tuple(row["case"]["effects"])})
        if row.get("code") == code and case in wanted:
            before.append(Outcome(**{name: row[name] for name in names - {"case"}}, case=case))
    return before


def main(argv: list[str] | None = None) -> int:
    """Run the plan, or its first part, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=None, help="the first N of the plan; default: all")
    parser.add_argument("--skip", type=int, default=0, help="so many records at the beginning of the plan are left out")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="records that hide an effect whose name holds this")
    parser.add_argument("--out", type=Path, default=Path("docs/blind.md"))
    parser.add_argument("--json", type=Path, default=Path("docs/blind.json"), help="an interrupted run goes on from it")
    options = parser.parse_args(argv)
    wanted = [case for case in cases(options.seed) if options.only in " ".join((case.kind, *case.effects))]
    wanted = wanted[options.skip : options.records]
    code = _code()
    outcomes = _done_before(options.json, wanted, code)
    known = {outcome.case for outcome in outcomes}
    left = [case for case in wanted if case not in known]
    failed: list[str] = []
    with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool:
        running = {pool.submit(_run, case, folder): case for case in left}
        for done, future in enumerate(as_completed(running), start=1 + len(known)):
            error = future.exception()
            if error is None:
                outcomes.append(future.result())
                _write(outcomes, options.json, code)  # after each outcome: an interrupted run can be resumed
            else:
                failed.append(f"{running[future]}: {error!r}")
            print(f"\r{done}/{len(wanted)} records", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    outcomes.sort(key=lambda outcome: (outcome.case.kind, outcome.case.effects, outcome.case.seed))
    _write(outcomes, options.json, code)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    planned = len(cases(options.seed))
    options.out.write_text(report(outcomes, options.seed, planned) + "\n" + NOTES.read_text() + made_at())
    print(options.out.read_text())
    if failed:
        print("without an answer:", *failed, sep="\n", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
