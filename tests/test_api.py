"""The public interface gives the same as the command, its pictures show what the diagnosis states, and no more."""

import io
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import rwa_monitor as rwa
from rwa_monitor import api, plot
from rwa_monitor.errors import InputError
from rwa_monitor.telemetry.table import write_csv
from rwa_monitor.threads import one_thread_of_algebra
from rwa_monitor.wheel.wheel import Window
from tests.program import run

WINDOW = 6000


@pytest.fixture(scope="module")
def wheel() -> rwa.Wheel:
    return rwa.read_wheel().model_copy(update={"window": Window(samples=WINDOW, hop=WINDOW)})


@pytest.fixture(scope="module")
def telemetry(wheel: rwa.Wheel) -> rwa.Telemetry:
    return rwa.simulate(rwa.Scenario(duration_s=1600.0), wheel, seed=36)  # the second window has jumps


def test_the_package_offers_what_the_interface_lists() -> None:
    assert set(rwa.__all__) == {*api.__all__, "plot", "__version__"}
    for name in rwa.__all__:
        assert getattr(rwa, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = rwa.nothing


def test_a_frame_has_a_row_for_each_diagnosis_and_survives_parquet(
    wheel: rwa.Wheel, telemetry: rwa.Telemetry, tmp_path: Path
) -> None:
    import pandas as pd

    diagnoses = rwa.diagnose(telemetry.samples, wheel)
    frame = rwa.frame(diagnoses)
    assert frame["window_start_ns"].tolist() == [d.window_start_ns for d in diagnoses]
    assert frame["viscous_Nm_s_rad"].tolist() == [d.friction.viscous.value for d in diagnoses]
    assert frame["dry_probability"].tolist() == [d.anomalies["dry"].probability for d in diagnoses]
    assert [json.loads(text) for text in frame["message"]] == [json.loads(d.to_json()) for d in diagnoses]
    frame.to_parquet(tmp_path / "d.parquet")
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "d.parquet"), frame, check_dtype=False)
    assert rwa.frame([]).empty


def test_diagnose_monitor_and_command_give_the_same(wheel: rwa.Wheel, telemetry: rwa.Telemetry, tmp_path: Path) -> None:
    table, wheel_file = tmp_path / "today.csv", tmp_path / "wheel.toml"
    write_csv(telemetry.samples, table)
    wheel_file.write_text(wheel.to_toml())
    samples = rwa.read(table)

    whole = rwa.diagnose(samples, wheel)
    assert [d.partial for d in whole] == [False, False, True]
    monitor = rwa.Monitor(wheel)
    cuts = [0, 1, 2500, 6001, 12050, len(samples)]
    parts = [d for a, b in pairwise(cuts) for d in monitor.feed(samples[a:b])] + monitor.finish()
    assert [d.to_json() for d in parts] == [d.to_json() for d in whole]
    assert monitor.counts["received"] == monitor.counts["used"] == len(samples)

    said = [json.loads(line) for line in run("diagnose", table, "--wheel", wheel_file, "--json").stdout.splitlines()]
    for message in said:
        assert message.pop("source") == str(table)
    assert said == [json.loads(d.to_json()) for d in whole]


def test_a_monitor_carries_on_what_another_learned(wheel: rwa.Wheel, telemetry: rwa.Telemetry) -> None:
    first = rwa.Monitor(wheel)
    first.feed(telemetry.samples[:6050])
    assert first.carried.sha256() != rwa.Monitor(wheel).carried.sha256()
    (after, *_) = rwa.diagnose(telemetry.samples[6000:], wheel, carried=first.carried)
    assert after.provenance.prior_sha256 != rwa.diagnose(telemetry.samples[6000:], wheel)[0].provenance.prior_sha256


def test_what_identify_learns_diagnoses_its_own_wheel(wheel: rwa.Wheel, telemetry: rwa.Telemetry) -> None:
    learned = rwa.identify({"healthy": telemetry.samples}, systems=False)
    assert learned.wheel.nominal.viscous_Nm_s_rad == pytest.approx(wheel.nominal.viscous_Nm_s_rad, rel=0.01)
    assert learned.wheel.sample_period_s == wheel.sample_period_s
    assert learned.notes
    assert rwa.Wheel.from_toml(learned.wheel.to_toml(), "again") == learned.wheel
    with pytest.raises(rwa.InputError, match="none given"):
        rwa.identify([])


def test_a_model_is_read(tmp_path: Path) -> None:
    file = tmp_path / "model.json"
    file.write_text(rwa.read_model().to_json(), encoding="utf-8")
    assert rwa.read_model(file) == rwa.read_model()
    file.write_text("{}", encoding="utf-8")
    with pytest.raises(rwa.RwaMonitorError, match=r"model\.json"):
        rwa.read_model(file)


# Everything that an answer can rest on, on a short record.
ANSWERS = """
import json
import rwa_monitor as rwa
scene = rwa.Scenario.from_toml('[scenario]\\nduration_s = 1000.0\\n[speed]\\nkind = "rich"\\n', "short")
samples = rwa.simulate(scene, seed=50012).samples
print(samples.friction_torque_Nm.tobytes().hex())
print(rwa.identify(samples, systems=False).wheel.to_toml())
print([diagnosis.to_json() for diagnosis in rwa.diagnose(samples)])
print(json.dumps(rwa.find_discrepancy(samples).result.to_json()))
"""


def test_answers_are_the_same_bytes_however_many_threads_linear_algebra_is_given() -> None:
    said = set()
    for threads in ("1", "4"):
        environment = os.environ | {"OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads}
        done = subprocess.run([sys.executable, "-c", ANSWERS], capture_output=True, env=environment, check=True)
        said.add(done.stdout)
    assert len(said) == 1


def test_linear_algebra_keeps_to_one_thread_while_something_computes(telemetry: rwa.Telemetry) -> None:
    def threads() -> set[int]:
        return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}

    seen: list[set[int]] = []
    with threadpool_limits(3, user_api="blas"):
        rwa.find_discrepancy(telemetry.samples, progress=lambda _: seen.append(threads()))
        assert seen
        assert all(found == {1} for found in seen)
        assert threads() == {3}  # as it was
        with one_thread_of_algebra(), ThreadPoolExecutor(1) as other:
            other.submit(one_thread_of_algebra()(threads)).result()
            assert threads() == {1}  # that another one ends does not end this one


def test_reading_warns_of_columns_left_out(tmp_path: Path) -> None:
    table = tmp_path / "odd.csv"
    table.write_text("time_s,speed_rad_s,friction_torque_Nm,colour\n0,100,0.002,1\n0.125,100,0.002,2\n")
    with pytest.warns(UserWarning, match="colour"):
        samples = rwa.read(table)
    assert len(samples) == 2


def test_what_cannot_be_used_is_refused_with_its_place(wheel: rwa.Wheel, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.csv"):
        rwa.read(tmp_path / "absent.csv")
    with pytest.raises(InputError, match="none given"):
        rwa.find_discrepancy([], wheel)
    speed_only = rwa.Samples(np.arange(3), np.ones(3))
    with pytest.raises(InputError, match="friction_torque_Nm is missing"):
        rwa.diagnose(speed_only, wheel)


# ---- pictures --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def diagnoses(wheel: rwa.Wheel, telemetry: rwa.Telemetry) -> list[rwa.Diagnosis]:
    return rwa.diagnose(telemetry.samples, wheel)


def test_a_window_shows_its_jumps_and_its_systems(
    telemetry: rwa.Telemetry, diagnoses: list[rwa.Diagnosis], wheel: rwa.Wheel
) -> None:
    diagnosis = diagnoses[1]
    assert diagnosis.changepoints, "a window without jumps shows nothing here"
    figure = plot.window(telemetry.samples, diagnosis, wheel)
    _, middle, bottom = figure.axes
    dots, *jumps = middle.lines
    minutes = [(jump.time_ns - diagnosis.window_start_ns) / 60e9 for jump in diagnosis.changepoints]
    np.testing.assert_allclose([line.get_xdata()[0] for line in jumps], minutes)
    # Friction less viscous is base dry plus that of the systems: the median distance of a dot is that of the noise.
    level = np.full(WINDOW, diagnosis.friction.base_dry.value)
    for system in diagnosis.friction.fss.values():
        lengths = np.diff([*system.start_index, WINDOW])
        level += np.repeat(system.friction_Nm, lengths)
    every = WINDOW // dots.get_xdata().size
    distance = np.nanmedian(np.abs(dots.get_ydata() - 1e3 * level[::every]))
    assert 0.5 < distance / (1e3 * diagnosis.fit.noise_std_Nm) < 1.0  # 0.674 for Gaussian noise
    assert [line.get_label() for line in bottom.lines] == list(diagnosis.friction.fss)
    figure.savefig(file := io.BytesIO(), format="png")
    assert file.getvalue().startswith(b"\x89PNG")


def test_friction_is_derived_where_it_is_not_given(
    telemetry: rwa.Telemetry, diagnoses: list[rwa.Diagnosis], wheel: rwa.Wheel
) -> None:
    given = telemetry.samples
    derived = rwa.Samples(given.time_ns, given.speed_rad_s, motor_current_A=given.motor_current_A)
    pictures = [plot.window(samples, diagnoses[0], wheel).axes[1].lines[0].get_ydata() for samples in (given, derived)]
    assert np.nanmedian(np.abs(pictures[0] - pictures[1])) < 3 * 1e3 * diagnoses[0].fit.noise_std_Nm


def test_a_window_without_samples_is_refused(telemetry: rwa.Telemetry, diagnoses: list[rwa.Diagnosis]) -> None:
    with pytest.raises(InputError, match="none lies in the window"):
        plot.window(telemetry.samples[:100], diagnoses[1])
