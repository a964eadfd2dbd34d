"""Many recordings at once: the same answers as one by one, whatever fails, and again only what is not done."""

import csv
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dask
import pytest
from distributed import LocalCluster

from rwa_monitor.batch.store import Store, read_results
from rwa_monitor.batch.tasks import Diagnose, map_files
from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.messages import Diagnosis
from rwa_monitor.monitor.setup import read_model, read_wheel
from tests.cli.conftest import simulate
from tests.program import command, run

RECORDINGS = 5


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory, files: Path) -> Path:
    """Return a folder with day_0.csv … day_4.csv, broken.csv, and the wheel that they are of."""
    folder = tmp_path_factory.mktemp("fleet")
    shutil.copy(files / "wheel.toml", folder)
    for seed in range(RECORDINGS):
        simulate(files / "scenario.toml", folder / "wheel.toml", seed, folder / f"day_{seed}.csv")
    (folder / "broken.csv").write_text("time_s,speed_rad_s\n0.0,fast\n")
    return folder


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    """Yield a Dask cluster of two processes, as somebody else would have started it."""
    host = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        LocalCluster(n_workers=2, threads_per_worker=1, **host) as cluster,
    ):
        yield cluster


def named(fleet: Path) -> list[Path]:
    """Return the recordings in an order that is not the alphabetical one, the broken one among them."""
    return [fleet / name for name in ("day_3.csv", "day_0.csv", "broken.csv", "day_4.csv", "day_1.csv", "day_2.csv")]


# ---- the same as one by one ------------------------------------------------------------------------------------------


def test_on_a_cluster_each_line_is_that_of_one_by_one_and_in_the_order_of_the_arguments(
    fleet: Path, cluster: LocalCluster, tmp_path: Path
) -> None:
    arguments = ["diagnose", *named(fleet), "--wheel", fleet / "wheel.toml", "--json"]
    alone = run(*arguments)
    spread = run(*arguments, "--scheduler", cluster.scheduler_address, "--results", tmp_path)
    assert (alone.exit_code, spread.exit_code) == (2, 2)
    assert spread.stdout == alone.stdout
    assert len(alone.stdout.splitlines()) == 3 * RECORDINGS
    assert "broken.csv: row 2, column speed_rad_s" in spread.stderr
    (failure,) = list(csv.DictReader((tmp_path / "failed.csv").read_text().splitlines()))
    assert failure["file"] == str(fleet / "broken.csv")
    assert "speed_rad_s" in failure["reason"]


def test_results_are_a_table_with_every_window_and_the_whole_message(fleet: Path, tmp_path: Path) -> None:
    where = ("--results", tmp_path, "--workers", 1)
    done = run("diagnose", *named(fleet), "--wheel", fleet / "wheel.toml", *where, "--json")
    table = read_results(tmp_path)
    assert table.num_rows == 3 * RECORDINGS
    by_message = [Diagnosis.model_validate_json(text) for text in table["message"].to_pylist()]
    assert [d.source for d in by_message] == sorted(d.source or "" for d in by_message)
    assert table["dry_probability"].to_pylist() == [d.anomalies["dry"].probability for d in by_message]
    assert table["base_dry_Nm"].to_pylist() == [d.friction.base_dry.value for d in by_message]
    assert {d.to_json() for d in by_message} == {line.encode() for line in done.stdout.splitlines()}


def test_training_on_a_cluster_gives_the_bytes_of_training_alone(cluster: LocalCluster, tmp_path: Path) -> None:
    folder, model = tmp_path / "labelled", tmp_path / "model.json"
    made = run("simulate", "dataset", "--recipe", "mild", "--count", 6, "--seed", 3, "-o", folder)
    assert made.exit_code == 0, made.stderr
    train = ("train", folder / "labels.csv", "--wheel", next(folder.glob("*.wheel.toml")), "-o", model)
    on_cluster = ("--scheduler", cluster.scheduler_address)
    models = []
    for where in (("--workers", 1), on_cluster):
        learned = run(*train, *where)
        assert learned.exit_code == 0, learned.stderr
        models.append(model.read_bytes())
    assert models[0] == models[1]
    model.unlink()
    (folder / "mild_00003.parquet").write_bytes(b"PAR1")
    refused = run(*train, *on_cluster)
    assert refused.exit_code == 2
    assert "mild_00003.parquet: is no readable Parquet file" in refused.stderr
    assert "labels.csv: 1 of 6 files cannot be used; nothing is written" in refused.stderr
    assert not model.exists()


NOT_INSTALLED = ("dask", "distributed", "matplotlib", "pandas", "pyarrow")


def test_a_default_installation_trains_and_diagnoses_many_recordings_in_processes(fleet: Path, tmp_path: Path) -> None:
    days = [fleet / f"day_{seed}.csv" for seed in range(RECORDINGS)]
    rows = "".join(f"{day},{seed % 2},0,0,0\n" for seed, day in enumerate(days))
    (fleet / "labels.csv").write_text(f"file,dry,viscous,fss_1,fss_2\n{rows}")
    wheel = ["--wheel", fleet / "wheel.toml"]
    (tmp_path / "first").mkdir()
    for name in NOT_INSTALLED:
        (tmp_path / "first" / f"{name}.py").write_text(f"raise ModuleNotFoundError('not installed', name={name!r})")
    path = os.pathsep.join([str(tmp_path / "first"), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)

    def bare(*arguments: object) -> subprocess.CompletedProcess[str]:
        environment = os.environ | {"PYTHONPATH": path}
        return subprocess.run(command(*arguments), capture_output=True, text=True, check=False, env=environment)

    trained = bare("train", fleet / "labels.csv", *wheel, "-o", tmp_path / "model.json", "--workers", 2)
    assert trained.returncode == 0, trained.stderr
    assert read_model(tmp_path / "model.json").trained.windows == 2 * RECORDINGS  # the half ones are left out
    done = bare("diagnose", *days, *wheel, "--model", tmp_path / "model.json", "--workers", 2, "--json")
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 3 * RECORDINGS
    refused = bare("diagnose", *days, *wheel, "--results", tmp_path / "results")
    assert refused.stderr == "rwa-monitor: pyarrow is missing: pip install 'rwa-monitor[parquet]'\n"
    refused = bare("diagnose", *days, *wheel, "--scheduler", "tcp://127.0.0.1:1")
    assert "pip install 'rwa-monitor[fleet]'" in refused.stderr


# ---- what is done already --------------------------------------------------------------------------------------------


def test_a_second_run_does_only_what_is_missing_or_changed(fleet: Path, tmp_path: Path) -> None:
    recordings = [shutil.copy(fleet / f"day_{number}.csv", tmp_path / f"copy_{number}.csv") for number in range(3)]
    results = tmp_path / "results"
    command = ["diagnose", *recordings, "--wheel", fleet / "wheel.toml", "--results", results, "--workers", 1, "--json"]
    first = run(*command)
    made = {path.name: path.stat().st_mtime_ns for path in results.glob("*.parquet")}
    assert len(made) == 3

    next(results.glob("diagnosis-copy_1.csv-*.parquet")).unlink()
    again = run(*command)
    assert again.stdout == first.stdout
    after = {path.name: path.stat().st_mtime_ns for path in results.glob("*.parquet")}
    assert [name for name in made if after[name] != made[name]] == [next(n for n in made if "copy_1" in n)]

    shutil.copy(fleet / "day_4.csv", recordings[2])
    changed = run(*command)
    assert changed.stdout.splitlines()[:6] == first.stdout.splitlines()[:6]
    assert changed.stdout != first.stdout


def test_other_settings_are_other_results(fleet: Path, tmp_path: Path) -> None:
    wheel = read_wheel(fleet / "wheel.toml")
    recording = fleet / "day_0.csv"
    names = {
        Store(tmp_path, task).path(recording).name
        for task in (Diagnose(), Diagnose(wheel), Diagnose(wheel, method="paper"), Diagnose(wheel))
    }
    assert len(names) == 3


def test_whatever_a_recording_is_called_its_result_stays_in_the_folder(tmp_path: Path) -> None:
    odd = tmp_path / "..;$(x) ü" / ("long" * 40 + ".csv")
    odd.parent.mkdir()
    odd.write_text("time_s\n")
    path = Store(tmp_path / "results", Diagnose()).path(odd)
    assert path.parent == tmp_path / "results"
    assert len(path.name) < 255
    assert path.name.isascii()


# ---- what fails ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Named:
    """A task that does what the file's name asks for."""

    def __call__(self, file: Path) -> str:
        if file.name == "bad input":
            raise InputError(str(file), "cannot be used")
        if file.name == "fault":
            raise ZeroDivisionError("of the program")
        if file.name == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        return file.name


@pytest.mark.parametrize("on_a_cluster", [False, True])
def test_neither_bad_input_nor_a_fault_nor_a_killed_worker_stops_the_others(
    on_a_cluster: bool, cluster: LocalCluster
) -> None:
    names = [f"good {number}" for number in range(200)]
    names[0], names[6], names[150] = "bad input", "fault", "killed"  # several travel together
    where: dict[str, Any] = {"scheduler": cluster.scheduler_address} if on_a_cluster else {"workers": 2}
    outcomes = list(map_files(Named(), [Path(name) for name in names], **where))
    assert [outcome.file.name for outcome in outcomes] == names
    errors = {outcome.file.name: outcome.error for outcome in outcomes if outcome.error}
    assert {outcome.result for outcome in outcomes if not outcome.error} == {*names} - {*errors}
    assert errors["bad input"] == "bad input: cannot be used"
    assert errors["fault"] == "fault: fault of the program: ZeroDivisionError: of the program"
    assert errors["killed"].startswith("killed: ")
    assert set(errors) == {"bad input", "fault", "killed"}


def test_no_scheduler_is_one_line() -> None:
    with pytest.raises(RwaMonitorError, match="no Dask scheduler answers"):
        list(map_files(Named(), [Path("good")], scheduler="tcp://127.0.0.1:9"))
    result = run("diagnose", "x.csv", "--scheduler", "carrier pigeon")
    assert (result.exit_code, result.stdout) == (1, "")
    assert "carrier pigeon" in result.stderr
