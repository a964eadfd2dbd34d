"""The onboard detector: the jumps of the monitor's recordings from a pipe, without Python, exceptions or allocation."""

import json
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from rwa_monitor.changepoints.evidence import WindowAccumulator
from rwa_monitor.errors import InputError
from rwa_monitor.export.c_source import detector_files
from rwa_monitor.export.model import friction_model
from rwa_monitor.monitor.recording import read_chain
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, to_block
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel
from tests.program import run

Jumps = list[tuple[int, float, float]]


def built(folder: Path, wheel: Wheel) -> Path:
    for name, data in detector_files(friction_model(wheel, "test")).items():
        (folder / name).write_bytes(data)
    subprocess.run(["make", "-s", "detector", f"DETECTOR_OUT={folder}"], check=True)
    return folder / "pipe"


def piped(program: Path, speed: FloatArray, friction: FloatArray) -> tuple[Jumps, int, int]:
    """Return the jumps that the example prints, and the bytes that it had and used."""
    lines = "\n".join(f"{a!r} {b!r}" for a, b in zip(speed.tolist(), friction.tolist(), strict=True))
    ran = subprocess.run([program], input=lines, capture_output=True, text=True, check=True)
    given, used = map(int, re.findall(r"\d+", ran.stderr))
    jumps = [(int(slot), float(jump), float(std)) for slot, jump, std in map(str.split, ran.stdout.splitlines())]
    return jumps, given, used


def monitored(wheel: Wheel, speed: FloatArray, friction: FloatArray) -> Jumps:
    window = WindowAccumulator(wheel, speed.size)
    found = window.append(speed, friction, np.ones(speed.size, dtype=np.bool_))
    return [(one.index, one.jump * wheel.torque_unit_Nm, one.std * wheel.torque_unit_Nm) for one in found]


def test_a_recordings_provisional_changepoints_are_printed(tmp_path: Path) -> None:
    """The recording's own messages, which the monitor wrote when it made the recording: slots, jumps and deviations."""
    messages = [message for recording in read_chain(Path("replay/nominal")) for message in recording.messages]
    attached = next(iter(read_chain(Path("replay/nominal")))).attachments
    (tmp_path / "wheel.toml").write_bytes(attached["wheel.toml"])
    assert run("export", tmp_path / "wheel.toml", "--to", "detector", "-o", tmp_path).exit_code == 0
    subprocess.run(["make", "-s", "detector", f"DETECTOR_OUT={tmp_path}"], check=True)
    samples = [json.loads(one.payload) for one in messages if one.topic.endswith("/samples")]
    speed, friction, times = (
        np.array([value for one in samples for value in one[name]], dtype=np.float64)
        for name in ("speed_rad_s", "friction_torque_Nm", "time_ns")
    )
    messages_of_jumps = [json.loads(one.payload) for one in messages if one.topic.endswith("/changepoints")]
    published = [jump for one in messages_of_jumps for jump in one["changepoints"]]
    jumps, _, _ = piped(tmp_path / "pipe", speed, friction)
    assert len(jumps) == 40
    assert [times[slot] for slot, _, _ in jumps] == [one["time_ns"] for one in published]
    assert [(jump, std) for _, jump, std in jumps] == [(one["jump_Nm"], one["std_Nm"]) for one in published]


@pytest.mark.parametrize("heavy", [False, True])
def test_a_full_window_of_any_noise_equals_the_monitors(heavy: bool, tmp_path: Path) -> None:
    wheel, rng = built_in_wheel(), np.random.default_rng(3)
    n = wheel.window.samples
    speed = 200.0 + 80.0 * np.sin(np.arange(n) / 3000.0)
    noise = rng.standard_t(3, n) if heavy else rng.standard_normal(n)
    level = np.repeat(rng.choice([1.6e-3, 2.4e-3], n // 200 + 1), 200)[:n]
    friction = level + 5.3e-6 * speed + 3.9e-5 * noise
    friction[5000:5100] = np.nan
    jumps, given, used = piped(built(tmp_path, wheel), speed, friction)
    assert len(jumps) > 100
    assert jumps == monitored(wheel, speed, friction)
    assert used < given


def test_the_memory_suffices_for_the_most_peaks_there_can_be(tmp_path: Path) -> None:
    """A jump every few slots fills the list of peaks, which is then pruned."""
    wheel, rng = built_in_wheel(), np.random.default_rng(4)
    n = wheel.window.samples
    speed = 200.0 + rng.normal(size=n)
    friction = np.where(np.arange(n) < 2000, 1.6e-3, rng.choice([1.6e-3, 4e-3, 9e-3], n)) + 3.9e-5 * rng.normal(size=n)
    jumps, given, used = piped(built(tmp_path, wheel), speed, friction)
    assert jumps == monitored(wheel, speed, friction)
    assert used < 0.8 * given


def test_the_library_demands_no_allocation_and_throws_nothing(tmp_path: Path) -> None:
    built(tmp_path, built_in_wheel())
    names = subprocess.run(
        ["nm", "--undefined-only", tmp_path / "librwa_detector.a"], capture_output=True, text=True, check=True
    ).stdout
    demanded = set(re.findall(r" U (\S+)", names))
    assert "sqrt" in demanded or "log" in demanded
    assert not demanded & {"malloc", "calloc", "realloc", "free", "__cxa_throw", "__cxa_begin_catch"}
    assert not [name for name in demanded if re.match(r"_Zn|_Zd", name)]  # operator new, operator delete


def test_a_wheel_whose_viscous_friction_follows_its_temperature_is_refused() -> None:
    warm = to_block(CATALOGUE["viscosity_temperature"].typical())
    with pytest.raises(InputError, match="viscosity_temperature changes its viscous friction"):
        detector_files(friction_model(built_in_wheel().model_copy(update={"effect": (warm,)}), "test"))
