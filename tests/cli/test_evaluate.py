"""`evaluate`: windows and labels into scores, from files as users have them, and what is refused."""

import json
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from rwa_monitor.cli.main import main
from tests.cli.conftest import simulate
from tests.program import run

ROOT = Path(__file__).parents[2]
WINDOW_NS = 10_000 * 10**9
LABELS = "file,dry,viscous\na.csv,1,0\nsub/b.csv,0,0\n"
EVENTS = "wheel,kind,start_ns,end_ns\n"


def line(source: str | None, start: int, *active: str, verdict: str = "", wheel: str = "w", **more: Any) -> str:
    """Return the line of a window, the start-th of its wheel, with what `evaluate` needs of it."""
    content = {
        "wheel": wheel,
        "source": source,
        "window_start_ns": start * WINDOW_NS,
        "window_end_ns": (start + 1) * WINDOW_NS,
        "verdict": verdict or ("anomalous" if active else "nominal"),
        "anomalies": {name: {"active": name in active} for name in ("dry", "viscous")},
    }
    return json.dumps(content | more) + "\n"


def run_on(folder: Path, lines: Iterable[str], labels: str) -> Result:
    """Run the command on lines and labels, both in files."""
    (folder / "found.jsonl").write_text("".join(lines))
    (folder / "labels.csv").write_text(labels)
    return run("evaluate", folder / "found.jsonl", folder / "labels.csv", "--json")


def evaluate(folder: Path, lines: list[str], labels: str) -> Any:
    """Return the JSON of the command on lines and labels."""
    result = run_on(folder, lines, labels)
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def test_labels_hold_for_all_windows_of_their_file(tmp_path: Path) -> None:
    lines = [line("x/a.csv", 0), line("x/a.csv", 1, "dry"), line("x/sub/b.csv", 0, "dry"), line("x/sub/b.csv", 1)]
    found = evaluate(tmp_path, lines, LABELS)
    assert (found["windows"], found["timelines"]) == (4, 2)
    dry = found["kinds"]["dry"]["diagnoses"]
    assert (dry["events"], dry["detected"], dry["false_alarms"]) == (1, 1, 1)
    assert dry["precision"] == pytest.approx(1 / 2 * (1 - 1 / 2))
    assert dry["timing"] == pytest.approx(0.5)  # half of the event late
    assert found["kinds"]["viscous"]["diagnoses"]["recall"] is None
    assert found["kinds"]["dry"]["always"]["false_alarms"] == 1
    assert found["kinds"]["dry"]["never"]["recall"] == 0.0


def test_events_are_in_the_time_of_their_wheel(tmp_path: Path) -> None:
    lines = [line(f"{k}.csv", k, *(["dry"] if k >= 6 else [])) for k in range(10)]
    lines += [line(None, k, "viscous", wheel="v", spacecraft="sat") for k in range(2)]
    events = f"{EVENTS}w,dry,{5 * WINDOW_NS},{10**18}\nsat/v,viscous,0,{WINDOW_NS}\n"
    found = evaluate(tmp_path, lines, events)
    dry, viscous, overall = (
        found[place]["diagnoses"] if place == "overall" else found["kinds"][place]["diagnoses"]
        for place in ("dry", "viscous", "overall")
    )
    assert (dry["precision"], dry["recall"], dry["timing_after"]) == (1.0, 1.0, 1.0)
    assert dry["timing"] == pytest.approx(1 / (1 + (1 / 4) ** 2.718281828459045))
    assert viscous["precision"] == pytest.approx(1 - 1 / 11)  # one of eleven windows without an event, half of it late
    assert (overall["events"], overall["detected"]) == (2, 2)


def test_events_of_several_kinds_at_once_are_one_of_any_kind(tmp_path: Path) -> None:
    found = evaluate(tmp_path, [line("a.csv", 0, "viscous")], "file,dry,viscous\na.csv,1,1\n")
    assert (found["kinds"]["dry"]["diagnoses"]["detected"], found["overall"]["diagnoses"]["events"]) == (0, 1)
    assert found["overall"]["diagnoses"]["f_0_5"] == 1.0


def test_an_inconclusive_window_raises_no_alarm(tmp_path: Path) -> None:
    found = evaluate(tmp_path, [line("a.csv", 0, "dry", verdict="inconclusive")], "file,dry,viscous\na.csv,1,0\n")
    assert found["kinds"]["dry"]["diagnoses"]["detected"] == 0


def test_neither_the_order_of_lines_nor_that_of_rows_matters(tmp_path: Path) -> None:
    lines = [line("a.csv", k, *(["dry"] if k in (0, 2, 3) else [])) for k in range(5)] + [line("sub/b.csv", 0, "dry")]
    header, *rows = LABELS.splitlines(keepends=True)
    there = evaluate(tmp_path, lines, LABELS)
    assert evaluate(tmp_path, lines[::-1], header + "".join(rows[::-1])) == there


def test_diagnoses_of_the_program_come_through_stdin(files: Path, tmp_path: Path) -> None:
    simulate(files / "scenario.toml", files / "wheel.toml", 1, tmp_path / "day.csv")
    (tmp_path / "labels.csv").write_text("file,dry,viscous,fss_1,fss_2\nday.csv,0,0,0,0\n")
    diagnosed = run("diagnose", tmp_path / "day.csv", "--wheel", files / "wheel.toml", "--json").stdout
    result = CliRunner().invoke(main, ["evaluate", "-", str(tmp_path / "labels.csv")], input=diagnosed)
    assert result.exit_code == 0, result.stderr
    heads = [row.split()[0] for row in result.stdout.splitlines()[2:]]
    kinds = ["dry", "viscous", "fss_1", "fss_2", "overall"]
    assert heads == [name for kind in kinds for name in (kind, "always", "never")]


def test_a_recording_of_the_monitor_serves_as_diagnoses(tmp_path: Path) -> None:
    (recording,) = sorted((ROOT / "replay/dry").glob("*.mcap"))
    shutil.copy(recording, tmp_path / "flight.mcap")
    (tmp_path / "labels.csv").write_text("file,dry,viscous,fss_1,fss_2\nflight.mcap,1,0,0,0\n")
    result = run("evaluate", tmp_path / "flight.mcap", tmp_path / "labels.csv", "--json")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    assert found["kinds"]["dry"]["diagnoses"]["recall"] == 1.0
    assert found["overall"]["diagnoses"]["false_alarms"] == 0
    whole = (tmp_path / "flight.mcap").read_bytes()
    (tmp_path / "flight.mcap").write_bytes(whole[: len(whole) * 3 // 4])
    cut = run("evaluate", tmp_path / "flight.mcap", tmp_path / "labels.csv", "--json")
    assert (cut.exit_code, json.loads(cut.stdout)["timelines"]) == (3, 1)
    assert "flight.mcap: bytes " in cut.stderr


A = line("a.csv", 0)
AB = A + line("sub/b.csv", 0)
# Name of the case: (diagnoses, labels, what the line must hold).
REFUSED = {
    "no diagnosis": ("\n", LABELS, "found.jsonl: holds no diagnosis; rwa-monitor diagnose FILE... --json makes them"),
    "no JSON": (f"{AB}x\n", LABELS, "found.jsonl: line 3: Invalid JSON"),
    "another message": ("{}\n", LABELS, "found.jsonl: line 1: wheel: Field required"),
    "no time": (line("a.csv", 0, window_end_ns=0), LABELS, "line 1: Value error, window_end_ns is not after"),
    "no labels": (AB, "name,dry\n", "row 1: the header must begin with file,dry,viscous, or be wheel,kind,"),
    "wrong columns": (AB, "wheel,kind,start_s,end_s\n", "row 1: the header must be wheel,kind,start_ns,end_ns"),
    "window without a label": (AB + line("c.csv", 0), LABELS, "labels.csv: has no row for c.csv, which has diagnoses"),
    "label without a window": (A, LABELS, "sub/b.csv; diagnose it too"),
    "a file labelled twice": (AB, f"{LABELS}./a.csv,0,0\n", "labels.csv: has two rows for "),
    "kind without a label": (AB.replace("viscous", "f"), LABELS, "row 1: has no column for 'f', which the diagnoses"),
    "label of no kind": (A, "file,dry,viscous,x\na.csv,0,0,0\n", "column x: no diagnosis judges this anomaly"),
    "windows of no file": (line(None, 0), LABELS, "w: its diagnoses name no file: "),
    "two files at once": (AB, EVENTS, "w: windows of a.csv and sub/b.csv start at the same time"),
    "unknown wheel": (A, f"{EVENTS}v,dry,0,1\n", "labels.csv: row 2, column wheel: no diagnosis is of 'v'"),
    "unknown kind": (A, f"{EVENTS}w,viscos,0,1\n", "row 2, column kind: no diagnosis is of 'viscos'; did you"),
    "too few fields": (A, f"{EVENTS}w,dry,0\n", "row 2: has 3 fields, the header has 4"),
    "no number": (A, f"{EVENTS}w,dry,0,1e9\n", "row 2, column end_ns: '1e9' is no whole number of nanoseconds"),
    "an event of no time": (A, f"{EVENTS}w,dry,5,5\n", "row 2, column end_ns: the event must end after it starts"),
    "an event elsewhere": (A, f"{EVENTS}w,dry,{WINDOW_NS},{10**18}\n", "row 2: the event lies outside of the time"),
}


@pytest.mark.parametrize(("lines", "labels", "message"), REFUSED.values(), ids=REFUSED)
def test_refused_in_one_line_with_exit_2(tmp_path: Path, lines: str, labels: str, message: str) -> None:
    result = run_on(tmp_path, lines, labels)
    assert (result.exit_code, result.stdout) == (2, ""), result.stderr
    (told,) = result.stderr.splitlines()
    assert message in told
