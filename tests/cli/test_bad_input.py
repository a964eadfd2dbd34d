"""Bad input, as a user meets it: one line on stderr with file, place and reason, exit code 2.

What each reader refuses is tested with the reader; here is what only the program reports, and one case of each reader.
"""

import json
import subprocess
from pathlib import Path

import pytest

from tests.program import command, done, run

HEAD = b"time_s,speed_rad_s,friction_torque_Nm\n"

# Name of the case: (name of the file, its content, arguments with {file} and {good}, what the line must hold).
CASES: dict[str, tuple[str, bytes | None, str, str]] = {
    "no table": ("none.csv", None, "diagnose {file}", "none.csv: cannot be read: No such file"),
    "text in a number": ("t.csv", HEAD + b"0,1,2\n1,x,2\n", "diagnose {file}", "row 3, column speed_rad_s: 'x'"),
    "friction unknown": ("t.csv", b"time_s,speed_rad_s\n0,1\n", "diagnose {file}", "friction cannot be derived"),
    "friction misspelt": (
        "t.csv",
        b"time_s,speed_rad_s,friction_torque_nm\n0,1,2\n",
        "diagnose {file}",
        "columns ignored: friction_torque_nm",
    ),
    "pulses of an unknown turn": (
        "t.csv",
        b"pulse_time_s\n0\n0.1\n",
        "discrepancy {file}",
        "t.csv: holds pulses: how many make a turn is pulses_per_turn, under [wheel] in the wheel file",
    ),
    "report into a file": ("t.csv", HEAD, "discrepancy {good} --out {file}", "t.csv: --out: is a file; a folder is"),
    "recording into a file": ("t.csv", HEAD, "run -l tcp/127.0.0.1:0 --record {file}", "t.csv: --record: is a file; a"),
    "wheels that are none": (
        "t.csv",
        HEAD,
        "run -l tcp/127.0.0.1:0 --record records --wheels sat/*",
        "--wheels: 'sat/*' takes no samples: they come on rwa/*/*/samples",
    ),
    "no Parquet": ("t.parquet", b"time_s\n", "diagnose {file}", "t.parquet: is no parquet file"),
    "no wheel": ("none.toml", None, "diagnose {good} --wheel {file}", "none.toml: cannot be read"),
    "wheel key misspelt": (
        "w.toml",
        b"[wheel]\nname='a'\nsample_period_s=0.1\n[nominal]\ndry_torque=1.6e-3\n",
        "diagnose {good} --wheel {file}",
        "w.toml: nominal.dry_torque: no key has this name; did you mean 'dry_torque_Nm'?",
    ),
    "wheel in Latin-1": ("w.toml", b"\n# caf\xe9\n", "diagnose {good} --wheel {file}", "row 2: is no UTF-8 text"),
    "model is no JSON": ("m.json", b"{", "diagnose {good} --model {file}", "m.json: is no model"),
    "unknown method": ("t.csv", HEAD, "diagnose {file} --method best", "'best' is not one of 'joint', 'paper'"),
    "no file named": ("t.csv", HEAD, "diagnose", "Missing argument 'FILE...'"),
    "scenario key misspelt": (
        "s.toml",
        b"[scenario]\nduration=1\n",
        "simulate recording --scenario {file} -o x.csv",
        "s.toml: duration: no key has this name; did you mean 'duration_s'?",
    ),
    "command misspelt": ("t.csv", HEAD, "diagnoze {file}", "No such command 'diagnoze'. Did you mean 'diagnose'?"),
    "option misspelt": ("t.csv", HEAD, "diagnose {file} --jsn", "No such option '--jsn'. Did you mean '--json'?"),
    "recipe misspelt": ("t.csv", HEAD, "simulate dataset --recipe papr --count 1 -o d", "did you mean 'paper'?"),
    "nowhere to write": ("t.csv", HEAD, "simulate recording -o no/folder/x.csv", "cannot be written: No such file"),
    "unknown format": ("t.csv", HEAD, "simulate recording -o x.xls", "must end in .csv or .parquet"),
    "no sub-command": ("x", b"", "simulate", "Missing command"),
    "option missing": ("x", b"", "simulate recording", "Missing option '-o'"),
    "seed below zero": ("x", b"", "simulate recording -o x.csv --seed -1", "-1 is not in the range"),
    "a demo of nan": ("x", b"", "demo --duration nan", "nan is no number here"),
    "port too large": ("x", b"", "demo --port 70000", "70000 is not in the range"),
    "many, but carried": ("x", b"", "diagnose x --carry --workers 2", "--carry takes one file after the other"),
    "cluster and here": (
        "x",
        b"",
        "diagnose x --scheduler tcp://127.0.0.1:1 --workers 2",
        "--workers is for this machine",
    ),
    "motor off, no inertia": (
        "w.toml",
        b"[wheel]\nname='bench'\nsample_period_s=0.125\n",
        "discrepancy {good} --wheel {file} --motor-off",
        "--motor-off: needs inertia_kg_m2 under [wheel]",
    ),
    "motor off, no wheel": (
        "x",
        b"",
        "identify {good} -o learned.toml --no-systems --motor-off",
        "--motor-off: needs inertia_kg_m2 under [wheel]",
    ),
    "settings of no command": (
        "s.toml",
        b"[diagnoze]\n",
        "--settings {file} doctor",
        "s.toml: diagnoze: is no command and no option; did you mean 'diagnose'?",
    ),
    "settings of no option": (
        "s.toml",
        b"[run]\nrecrod = 'x'\n",
        "--settings {file} doctor",
        "s.toml: run.recrod: is no command and no option; did you mean 'record'?",
    ),
    "settings without a table": (
        "s.toml",
        b"run = 3\n",
        "--settings {file} doctor",
        "s.toml: run: is no table of options, such as [run]",
    ),
    "settings that are none": ("s.toml", b"[run\n", "--settings {file} doctor", "is no valid TOML"),
    "a flag in words in settings": (
        "s.toml",
        b"[discrepancy]\nheld-out = [5]\nmotor-off = 'so'\n",
        "--settings {file} discrepancy x.csv",
        "'--motor-off': 'so' is not",
    ),
    "a speed below zero in settings": (
        "s.toml",
        b"[simulate.publish]\nspeed = -1.0\n",
        "--settings {file} simulate publish",
        "'--speed': -1.0 is not in the range",
    ),
    "endpoint without a port": (
        "x",
        b"",
        "simulate publish -l tcp/127.0.0.1",
        "--listen: 'tcp/127.0.0.1' is no endpoint: write tcp/",
    ),
}


@pytest.mark.parametrize(("name", "content", "arguments", "message"), CASES.values(), ids=CASES)
def test_one_line_and_exit_2(
    files: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    content: bytes | None,
    arguments: str,
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    if content is not None:
        Path(name).write_bytes(content)
    places = {"file": tmp_path / name, "good": files / "given.csv", "wheel": files / "wheel.toml"}
    result = run(*(word.format(**places) for word in arguments.split()))
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
