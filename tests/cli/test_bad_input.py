"""Bad input, as a user meets it: one line on stderr with file, place and reason, exit code 2.

What each reader refuses is tested with the reader; here is what only the program reports, and one case of each reader.
"""

import json
import re
import subprocess
from pathlib import Path

import pytest

from tests.program import command, done, run

HEAD, ROW = b"time_s,speed_rad_s,friction_torque_Nm\n", b"0,1,2\n"

# Name of the case: arguments (with {good} for a recording), what the line must hold, and what the file in them holds.
CASES: dict[str, tuple[str, str] | tuple[str, str, bytes]] = {
    "no table": ("diagnose none.csv", "none.csv: cannot be read: No such file"),
    "text in a number": ("diagnose t.csv", "row 3, column speed_rad_s: 'x'", HEAD + ROW + b"1,x,2\n"),
    "friction unknown": ("diagnose t.csv", "friction cannot be derived", b"time_s,speed_rad_s\n0,1\n"),
    "friction misspelt": ("diagnose t.csv", "columns ignored: friction_torque_nm", HEAD.replace(b"Nm", b"nm") + ROW),
    "pulses of an unknown turn": (
        "discrepancy t.csv",
        "t.csv: holds pulses: how many make a turn is pulses_per_turn",
        b"pulse_time_s\n0\n0.1\n",
    ),
    "report into a file": ("discrepancy {good} --out t.csv", "t.csv: --out: is a file; a folder is", HEAD),
    "recording into a file": ("run -l tcp/127.0.0.1:0 --record t.csv", "t.csv: --record: is a file; a", HEAD),
    "wheels that are none": ("run -l tcp/127.0.0.1:0 --record r --wheels sat/*", "--wheels: 'sat/*' takes no samples"),
    "no Parquet": ("diagnose t.parquet", "t.parquet: is no parquet file", b"time_s\n"),
    "wheel key misspelt": (
        "diagnose {good} --wheel w.toml",
        "w.toml: nominal.dry_torque: no key has this name; did you mean 'dry_torque_Nm'?",
        b"[wheel]\nname='a'\nsample_period_s=0.1\n[nominal]\ndry_torque=1.6e-3\n",
    ),
    "wheel in Latin-1": ("diagnose {good} --wheel w.toml", "row 2: is no UTF-8 text", b"\n# caf\xe9\n"),
    "model is no JSON": ("diagnose {good} --model m.json", "m.json: is no model", b"{"),
    "unknown method": ("diagnose t.csv --method best", "'best' is not one of 'joint', 'paper'"),
    "no file named": ("diagnose", "Missing argument 'FILE...'"),
    "command misspelt": ("diagnoze t.csv", "No such command 'diagnoze'. Did you mean 'diagnose'?"),
    "option misspelt": ("diagnose t.csv --jsn", "No such option '--jsn'. Did you mean '--json'?"),
    "recipe misspelt": ("simulate dataset --recipe papr --count 1 -o d", "did you mean 'paper'?"),
    "nowhere to write": ("simulate recording -o no/folder/x.csv", "cannot be written: No such file"),
    "unknown format": ("simulate recording -o x.xls", "must end in .csv or .parquet"),
    "no sub-command": ("simulate", "Missing command"),
    "seed below zero": ("simulate recording -o x.csv --seed -1", "-1 is not in the range"),
    "a demo of nan": ("demo --duration nan", "nan is no number here"),
    "many, but carried": ("diagnose x --carry --workers 2", "--carry takes one file after the other"),
    "cluster and here": ("diagnose x --scheduler tcp://127.0.0.1:1 --workers 2", "--workers is for this machine"),
    "motor off, no inertia": (
        "discrepancy {good} --wheel w.toml --motor-off",
        "--motor-off: needs inertia_kg_m2 under [wheel]",
        b"[wheel]\nname='bench'\nsample_period_s=0.125\n",
    ),
    "motor off, no wheel": ("identify {good} -o l.toml --motor-off", "--motor-off: needs inertia_kg_m2 under [wheel]"),
    "settings of no command": ("--settings s.toml doctor", "diagnoze: is no command and no option;", b"[diagnoze]\n"),
    "settings of no option": (
        "--settings s.toml doctor",
        "s.toml: run.recrod: is no command and no option; did you mean 'record'?",
        b"[run]\nrecrod = 'x'\n",
    ),
    "settings without a table": ("--settings s.toml doctor", "s.toml: run: is no table of options", b"run = 3\n"),
    "settings that are none": ("--settings s.toml doctor", "is no valid TOML", b"[run\n"),
    "a flag in words in settings": (
        "--settings s.toml discrepancy x.csv",
        "'--motor-off': 'so' is not",
        b"[discrepancy]\nheld-out = [5]\nmotor-off = 'so'\n",
    ),
    "a speed below zero in settings": (
        "--settings s.toml simulate publish",
        "'--speed': -1.0 is not in the range",
        b"[simulate.publish]\nspeed = -1.0\n",
    ),
    "endpoint without a port": ("simulate publish -l tcp/127.0.0.1", "--listen: 'tcp/127.0.0.1' is no endpoint"),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_one_line_and_exit_2(
    files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: tuple[str, str] | tuple[str, str, bytes]
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments, message, *contents = case
    for content in contents:
        Path(re.search(r"\b[a-z]\.[a-z]+", arguments)[0]).write_bytes(content)
    result = run(*(word.format(good=files / "given.csv") for word in arguments.split()))
    assert (result.exit_code, result.stdout) == (2, ""), result.stderr
    (line,) = result.stderr.splitlines()
    assert line.startswith("rwa-monitor: ")
    assert message in line


def test_a_process_of_its_own_reports_it_as_well() -> None:
    refused = done("diagnose", "none.csv")
    said = "rwa-monitor: none.csv: cannot be read: No such file or directory\n"
    assert (refused.returncode, refused.stdout, refused.stderr) == (2, "", said)


def test_json_lines_survive_a_file_name_that_is_no_utf8(files: Path, tmp_path: Path) -> None:
    name = bytes(tmp_path) + b"/caf\xe9.csv"
    with open(name, "wb") as file:
        file.write((files / "given.csv").read_bytes())
    words = [*command("diagnose"), name, "--wheel", str(files / "wheel.toml"), "--json"]
    first, *_ = subprocess.run(words, capture_output=True, timeout=120, check=True).stdout.splitlines()
    assert json.loads(first)["source"].endswith("/caf\ufffd.csv")
