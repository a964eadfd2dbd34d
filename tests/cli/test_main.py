"""The command as a user meets it: help, version, exit codes, one line for what is wrong."""

import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from rwa_monitor import __version__
from rwa_monitor.cli.doctor import look_at_bus, look_at_recordings
from rwa_monitor.cli.main import COMMANDS, main
from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.monitor.bus import BusOptions, open_session
from rwa_monitor.monitor.recorder import locked
from tests.dashboard.support import repeated
from tests.monitor.support import free_port
from tests.program import command, run


def all_commands() -> list[list[str]]:
    """Return the words of every command and sub-command."""
    context = click.Context(main)
    found = []
    for name in main.list_commands(context):
        group = main.get_command(context, name)
        found.append([name])
        if isinstance(group, click.Group):
            found += [[name, sub] for sub in group.list_commands(context)]
    return found


def run_code(code: str) -> subprocess.CompletedProcess[str]:
    """Run Python code in a process of its own."""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("words", all_commands(), ids=" ".join)
def test_every_command_has_a_help_that_states_what_it_does(words: list[str]) -> None:
    result = run(*words, "--help")
    assert result.exit_code == 0
    assert result.stdout.startswith(f"Usage: rwa-monitor {' '.join(words)} ")
    _, first_sentence, *_ = (part.strip() for part in result.stdout.split("\n\n"))
    assert first_sentence.endswith((".", "]"))


def test_help_lists_every_command_and_the_version_is_printed() -> None:
    listed = run("--help").stdout
    assert all(f"\n  {name} " in listed for name in COMMANDS)
    result = run("--version")
    assert (result.exit_code, result.stdout) == (0, f"rwa-monitor {__version__}\n")
    result = run()
    assert (result.exit_code, result.stderr) == (2, listed)


def test_help_loads_nothing_heavy() -> None:
    """The figure in seconds is information; what decides is what was loaded."""
    code = (
        "import sys\nfrom rwa_monitor.cli.main import main\n"
        "try: main(['--help'])\nexcept SystemExit: pass\n"
        "heavy = {'numpy', 'scipy', 'sklearn', 'zenoh', 'matplotlib', 'pyarrow', 'pydantic', 'mcap', 'rich', 'dask'}\n"
        "print(sorted(heavy & set(sys.modules)), file=sys.stderr)\n"
    )
    began = time.perf_counter()
    done = run_code(code)
    print(f"--help: {time.perf_counter() - began:.3f} s")
    assert done.stderr == "[]\n"


# ---- errors and exit codes -------------------------------------------------------------------------------------------


def run_raising(error: BaseException, monkeypatch: pytest.MonkeyPatch) -> tuple[int, str]:
    """Run the program with a command that raises; return the exit code and stderr."""

    @click.command()
    def raising() -> None:
        raise error

    monkeypatch.setattr(main, "get_command", lambda ctx, name: raising)
    result = run("raising")
    return result.exit_code, result.stderr


def test_each_kind_of_error_has_its_exit_code_and_a_fault_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    status, said = run_raising(InputError("a\nfile", "is\n  bad", "row 3"), monkeypatch)
    (line,) = said.splitlines()
    assert (status, line.startswith("rwa-monitor: a"), "row 3: is" in line) == (2, True, True)
    assert run_raising(RwaMonitorError("the disk is full"), monkeypatch) == (1, "rwa-monitor: the disk is full\n")
    assert run_raising(KeyboardInterrupt(), monkeypatch)[0] == 130
    with pytest.raises(ZeroDivisionError):
        run_raising(ZeroDivisionError(), monkeypatch)


def test_a_reader_that_leaves_early_is_no_error_worth_a_word() -> None:
    """`head` closes the pipe: no traceback and no complaint while Python shuts down."""
    producer = subprocess.Popen(command("--help"), stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    producer.stdout.close()
    _, complaint = producer.communicate(timeout=60)
    assert complaint == b""
    assert producer.returncode == 1


def without_package(name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the program where a package is not installed."""
    return run_code(
        f"import sys; sys.modules[{name!r}] = None; from rwa_monitor.cli.main import main; main({list(arguments)})"
    )


@pytest.mark.parametrize("words", [["diagnose", "none.csv"], ["doctor"]])
def test_a_package_that_is_missing_is_named_in_one_line(words: list[str]) -> None:
    done = without_package("numpy", *words)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "rwa-monitor: the package numpy is missing: install rwa-monitor again, with pip install .\n"


def test_a_missing_driver_of_the_database_is_reported_with_what_installs_it() -> None:
    done = without_package("psycopg", "dashboard", "--history", "postgresql://a@127.0.0.1:1/b", "-l", "tcp/127.0.0.1:0")
    assert done.returncode == 2
    assert "psycopg is missing: pip install 'rwa-monitor[postgresql]'" in done.stderr


def test_without_arrow_a_csv_is_written_and_what_is_left_out_is_named(tmp_path: Path) -> None:
    hint = "pyarrow is missing: pip install 'rwa-monitor[parquet]'\n"
    done = without_package("pyarrow", "simulate", "recording", "-o", str(tmp_path / "x.csv"))
    assert done.returncode == 0, done.stderr
    assert done.stderr.startswith(f"rwa-monitor: no table of the truth in every slot: {hint}")
    assert {path.name for path in tmp_path.iterdir()} == {"x.csv", "x.csv.truth.json"}
    (tmp_path / "y.parquet").write_bytes(b"PAR1")
    refused = without_package("pyarrow", "diagnose", str(tmp_path / "y.parquet"))
    assert (refused.returncode, refused.stderr) == (1, f"rwa-monitor: {hint}")


RUN = """
import sys
from rwa_monitor.monitor import service
service.run = lambda *given, **options: None
from rwa_monitor.cli.main import main
main(["run"], standalone_mode=False)

import numpy as np
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.wheel.wheel import built_in_wheel
from rwa_monitor.samples import Samples

slot = np.arange(4_000)
speed = 100.0 + 20.0 * np.sin(slot / 300.0)
friction = 1.5e-3 + 1e-6 * speed + 2e-5 * np.random.default_rng(1).standard_normal(slot.size)
samples = Samples(slot * 125_000_000, speed, friction)
assert list(diagnose_samples(samples, built_in_wheel(), built_in_model()))
print(*sys.modules, sep="\\n")
"""
NOT_FOR_A_MONITOR = (
    "rwa_monitor.api", "rwa_monitor.discrepancy", "benchmarks", "rwa_monitor.identification",
    "scipy.ndimage", "scipy.optimize", "scipy.signal", "scipy.stats",
    "dask", "joblib", "jinja2", "matplotlib", "pandas", "pyarrow", "sklearn",
)  # fmt: skip


def test_a_monitor_loads_nothing_that_it_does_not_use() -> None:
    done = run_code(RUN)
    assert done.returncode == 0, done.stderr
    loaded = done.stdout.splitlines()
    assert "rwa_monitor.monitor.service" in loaded
    assert [name for name in loaded if any(f"{name}.".startswith(f"{one}.") for one in NOT_FOR_A_MONITOR)] == []


# ---- options from file, environment and command line -----------------------------------------------------------------


def test_the_command_line_goes_before_the_environment_before_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def printed(*words: object) -> str:
        result = run(*words)
        assert result.exit_code == 0, result.stderr
        return result.stdout

    settings = tmp_path / "settings.toml"
    settings.write_text("[tune]\nmissed = 0.002\nrun-length = 2e6\njump = 9.0\n")
    # `tune` has numbers as options and needs no file.
    nine, eight, seven = (
        printed("tune", "--missed", "0.002", "--run-length", "2e6", "--jump", jump) for jump in (9, 8, 7)
    )
    assert len({nine, eight, seven}) == 3
    assert printed("--settings", settings, "tune") == nine
    monkeypatch.setenv("RWA_MONITOR_SETTINGS", str(settings))
    assert printed("tune") == nine
    monkeypatch.setenv("RWA_MONITOR_TUNE_JUMP", "8")
    assert printed("tune") == eight
    assert printed("tune", "--jump", 7) == seven


def test_doctor_does_not_take_an_empty_line_for_a_bus() -> None:
    told = run("doctor", "-e", f"tcp/127.0.0.1:{free_port()}")
    assert told.exit_code == 1
    assert "FAILED  bus: nothing answers at tcp/127.0.0.1:" in told.stdout


def test_bash_completes_commands_and_options() -> None:
    def completed(words: str, number: int) -> set[str]:
        environment: dict[str, Any] = {
            "_RWA_MONITOR_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(number)
        }  # fmt: skip
        result = CliRunner().invoke(main, [], env=environment, prog_name="rwa-monitor", standalone_mode=True)
        return {line.partition(",")[2] for line in result.stdout.splitlines()}

    assert {"diagnose", "discrepancy"} <= completed("rwa-monitor di", 1)
    assert completed("rwa-monitor diagnose --met", 2) == {"--method"}


# Signals at any moment of waits: SIGALRM goes to the handler of SIGTERM.
SIGNALLED = """
import random, signal
from rwa_monitor.cli.options import stop_on_signals

rng = random.Random(1)
with stop_on_signals() as stop:
    signal.signal(signal.SIGALRM, signal.getsignal(signal.SIGTERM))
    for _ in range(20_000):
        signal.setitimer(signal.ITIMER_REAL, rng.uniform(1e-6, 5e-5))
        while not stop.wait(0.01):  # a signal just before a wait is seen after it
            pass
        stop.clear()
"""


def test_a_signal_stops_a_wait_whenever_it_comes() -> None:
    assert run_code(SIGNALLED).returncode == 0


# ---- what `doctor` reports of the folders of a monitor and of who is on its bus --------------------------------------


RECORDING = Path(__file__).parents[2] / "replay" / "nominal" / "rwa-000001.mcap"


def test_what_a_folder_holds_is_reported_and_none_is_made(tmp_path: Path) -> None:
    assert look_at_recordings(tmp_path / "a").endswith("is not there yet")
    assert not (tmp_path / "a").exists()
    assert "holds no recording yet" in look_at_recordings(tmp_path)
    with locked(tmp_path), pytest.raises(RwaMonitorError, match="another monitor records in it"):
        look_at_recordings(tmp_path)
    shutil.copy(RECORDING, tmp_path)
    assert look_at_recordings(tmp_path).endswith(f"goes on from {RECORDING.name}")


@pytest.mark.processes
def test_who_is_on_the_bus_is_reported() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    assert "nobody has connected" in look_at_bus(BusOptions(listen=(endpoint,)))
    with open_session(BusOptions(listen=(endpoint,))) as session:
        keys = ("rwa/sat/rw1/samples", "rwa/sat/rw2/status")
        with repeated(lambda: [session.put(key, b"{}") for key in keys]):
            told = look_at_bus(BusOptions(connect=(endpoint,)))
    assert "1 peer connected; in 3 s received telemetry of 1 wheel (sat/rw1), monitors of 1 wheel (sat/rw2)" in told
    assert told.endswith("; nobody monitors sat/rw1")
