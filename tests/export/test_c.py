"""The exported C: equal to the simulation for every effect, as strict as promised; and the onboard detector."""

import ctypes
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from rwa_monitor.changepoints.evidence import WindowAccumulator
from rwa_monitor.errors import InputError
from rwa_monitor.export import FORMATS
from rwa_monitor.export.c_source import detector_files
from rwa_monitor.export.model import friction_model, to_json
from rwa_monitor.monitor.recording import read_chain
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects import catalogue
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, build, to_block
from rwa_monitor.wheel.effects.formula import FORMULAS
from rwa_monitor.wheel.wheel import EffectBlock, Wheel, built_in_wheel
from tests.export.script import STRICT, compiled, largest_difference, run_c, simulated, wheel_with
from tests.program import run

EQUAL_WITHIN = 1e-9  # relative, of each sample: the demand
HELD = sorted(name for name, effect in CATALOGUE.items() if not effect.not_exported)
NOT_HELD = sorted(CATALOGUE.keys() - set(HELD))
EXPORT_PAGE = Path(__file__).parents[2] / "docs" / "export.md"
LAWS = sorted({re.sub(r"^\w+\*", "", law) for law in FORMULAS})


def blocks(*names: str) -> list[EffectBlock]:
    return [to_block(CATALOGUE[name].typical()) for name in names]


@pytest.fixture(scope="module")
def plain() -> FloatArray:
    return simulated(wheel_with()).torque_Nm


def check(wheel: Wheel, plain: FloatArray, folder: Path) -> None:
    script = simulated(wheel)
    assert np.max(np.abs(script.torque_Nm - plain)) > 1e-7  # the script shows the effect
    assert largest_difference(run_c(wheel, script, folder), script.torque_Nm) < EQUAL_WITHIN


def test_what_is_exported_and_what_is_left_out_for_a_stated_reason_are_the_whole_catalogue() -> None:
    model = to_json(friction_model(wheel_with(*blocks(*CATALOGUE)), "all effects"))
    assert sorted(part["name"] for part in model["effects"]) == HELD
    reasons = {part["name"]: part["reason"] for part in model["not_held"]}
    assert sorted(reasons) == NOT_HELD
    assert all(reasons.values())
    page = EXPORT_PAGE.read_text(encoding="utf-8")
    table = page.partition("## What is not held")[2].partition("\n## ")[0].splitlines()
    assert sorted(re.findall(r"`(\w+)`", "".join(line for line in table if line.startswith("| `")))) == NOT_HELD
    for text in (page, EXPORT_PAGE.with_name("promises.md").read_text(encoding="utf-8")):
        assert f"{len(HELD)} of the {len(CATALOGUE)} effects" in text


@pytest.mark.parametrize("name", HELD)
def test_each_effect_equals_the_simulation(name: str, plain: FloatArray, tmp_path: Path) -> None:
    check(wheel_with(*blocks(name)), plain, tmp_path)


@pytest.mark.parametrize("law", LAWS)
def test_each_formula_equals_the_simulation(law: str, plain: FloatArray, tmp_path: Path) -> None:
    for number, structure in enumerate(FORMULAS[one] for one in FORMULAS if one.endswith(f"*{law}")):
        names = {parameter.name for parameter in structure.parameters}
        inside = {"temperature_centre_degC": 20.5}.items()  # of what the script's temperatures reach
        formula = structure.typical(**{name: value for name, value in inside if name in names})
        folder = tmp_path / str(number)
        folder.mkdir()
        check(wheel_with(to_block(formula)), plain, folder)


def test_all_effects_together_equal_the_simulation(plain: FloatArray, tmp_path: Path) -> None:
    check(wheel_with(*blocks(*HELD), to_block(FORMULAS["dry*wave(angle)"].typical())), plain, tmp_path)


def test_shapes_that_take_another_way_equal_the_simulation(plain: FloatArray, tmp_path: Path) -> None:
    shapes = [
        CATALOGUE["stribeck"].typical(exponent=1.3),
        CATALOGUE["saturating_drag"].typical(bend=2.5),
        CATALOGUE["sublinear_viscous"].typical(activation_temperature_K=3000.0),
        CATALOGUE["viscosity_temperature"].typical(sensor_lag_s=300.0),
    ]
    check(wheel_with(*map(to_block, shapes)), plain, tmp_path)


def test_a_lost_speed_holds_the_memory_as_the_package_does(tmp_path: Path) -> None:
    wheel = wheel_with(*blocks("lubricant_lag", "presliding"))
    script = simulated(wheel)
    script.inputs[3000:3200, 0] = np.nan
    torque = run_c(wheel, script, tmp_path)
    speed, level = np.ascontiguousarray(script.inputs[:, 0]), script.inputs[:, 4]
    unused = np.zeros(speed.size)
    channels = Channels(unused, speed, np.sign(speed), unused, unused, script.period_s, np.ones(speed.size, bool))
    expected = np.sign(speed) * level + built_in_wheel().nominal.viscous_Nm_s_rad * speed
    for block in wheel.effect:
        expected = expected + build(block).torque(channels)[0]
    known = np.isfinite(speed)
    assert np.isnan(torque[~known]).all()
    assert largest_difference(torque[known], expected[known]) < EQUAL_WITHIN


def test_the_first_step_does_not_count(tmp_path: Path) -> None:
    library = compiled(wheel_with(*blocks(*HELD)), tmp_path)
    model = library.rwa_friction_torque
    model.argtypes, model.restype = [ctypes.c_void_p, *[ctypes.c_double] * 5], ctypes.c_double
    torques = []
    for first_s in (0.0, 7.0, float("nan")):
        state = ctypes.create_string_buffer(1000)
        library.rwa_friction_init(state)
        torques.append([model(state, 10.0 + k, 1.0, 0.1, 20.0, step) for k, step in enumerate([first_s, 0.125, 0.0])])
    assert np.isfinite(torques).all()
    assert torques[0] == torques[1] == torques[2]


def test_an_acceleration_that_is_not_known_gives_no_torque_where_the_motor_torque_follows_it(tmp_path: Path) -> None:
    model = compiled(wheel_with(*blocks("load_dependence")), tmp_path).rwa_friction_torque
    model.argtypes, model.restype = [ctypes.c_void_p, *[ctypes.c_double] * 5], ctypes.c_double
    state = ctypes.create_string_buffer(1000)
    assert np.isnan(model(state, 10.0, float("nan"), 0.1, 20.0, 0.0))
    assert np.isfinite(model(state, 10.0, 0.5, 0.1, 20.0, 0.1))


def test_what_cppcheck_knows_of_misras_rules_holds(tmp_path: Path) -> None:
    if shutil.which("cppcheck") is None:
        pytest.skip("no cppcheck: apt-get install cppcheck")
    compiled(wheel_with(*blocks(*HELD), to_block(FORMULAS["dry*wave(angle)"].typical())), tmp_path)
    # Rule 8.7: both functions are used in another file, the simulator's.
    words = ["cppcheck", "--quiet", "--addon=misra", "--enable=style", "--std=c99", "--suppress=misra-c2012-8.7"]
    done = subprocess.run([*words, "rwa_friction.c"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stderr == ""


def test_errors_and_the_report_stand_in_the_header_and_names_stay_comments(tmp_path: Path) -> None:
    (block,) = blocks("stribeck")
    sha = "ab" * 32
    stated = block.model_copy(update={"std": {"strength_Nm": 1.5e-5}, "report_sha256": sha})
    wheel = wheel_with(stated, *blocks(*NOT_HELD)).model_copy(update={"name": 'x */ #error "out" /* ??/ é'})
    compiled(wheel, tmp_path)
    header = (tmp_path / "rwa_friction.h").read_text(encoding="ascii")
    assert sha in header
    assert wheel.sha256() in header
    assert "strength_Nm = 0.0005 N m, error 1.5e-05" in header
    assert "stribeck_speed_rad_s = 8.0 rad/s, error not known" in header
    for name in NOT_HELD:
        about = header.partition(f"NOT HELD: {name}\n")[2].partition(" *\n")[0]
        assert "Why: " in about
        assert "Cost: " in about
    assert "an RMSE of 0.00" in header  # of the current's delay
    source = (tmp_path / "rwa_friction.c").read_text(encoding="ascii")
    assert "malloc" not in source
    assert re.findall(r"#include (\S+)", source) == ['"rwa_friction.h"', "<float.h>", "<math.h>"]


def test_the_header_is_taken_by_a_cpp_compiler(tmp_path: Path) -> None:
    compiled(wheel_with(), tmp_path)
    (tmp_path / "user.cpp").write_text(
        '#include "rwa_friction.h"\nint main() { rwa_friction_state s; '
        "rwa_friction_init(&s); return rwa_friction_torque(&s, 1, 0, 0, 20, 1) < 0; }\n"
    )
    subprocess.run(["gcc", *STRICT, "-c", "rwa_friction.c"], cwd=tmp_path, check=True)
    subprocess.run(["g++", "-Wall", "-Wextra", "-Werror", "user.cpp", "rwa_friction.o"], cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "a.out"], check=True)


def test_the_command_writes_the_same_bytes_again(tmp_path: Path) -> None:
    file = tmp_path / "wheel.toml"
    file.write_text(wheel_with(*blocks("stribeck", "coloured_noise")).to_toml(), encoding="utf-8")
    for folder in ("one", "two/deep"):
        result = run("export", file, "--to", "c", "-o", tmp_path / folder)
        assert result.exit_code == 0, result.stderr
        assert "not held: coloured_noise" in result.stderr
    written = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert written == ["rwa_friction.c", "rwa_friction.h"]
    for name in written:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two/deep" / name).read_bytes()


def test_json_holds_constants_formulas_and_what_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / "wheel.toml"
    law = to_block(FORMULAS["dry*tanh(speed)"].typical())
    file.write_text(wheel_with(*blocks("stribeck", "coloured_noise"), law).to_toml(), encoding="utf-8")
    assert run("export", file, "--to", "json", "-o", tmp_path / "out").exit_code == 0
    model = json.loads((tmp_path / "out" / "rwa_friction.json").read_text(encoding="utf-8"))
    assert model["base"]["dry_level_Nm"] == 1.6e-3
    assert [effect["name"] for effect in model["effects"]] == ["stribeck", "formula"]
    assert model["effects"][1]["law"] == law.law
    assert model["effects"][0]["constants"][0] == {"name": "strength_Nm", "value": 5e-4, "std": None, "unit": "N m"}
    assert model["not_held"][0]["reason"]


class Untraceable(MeanEffect):
    name = "untraceable"
    title = formula = description = signature = separate_by = source = "-"
    parameters = (Parameter("strength_Nm", "N m", 0.0, 1.0, 1e-4, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        return np.cumsum(channels.speed_rad_s)


class Branching(Untraceable):
    name = "branching"

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        return channels.direction if channels.speed_rad_s > 0 else -channels.direction


@pytest.mark.parametrize(("effect", "what"), [(Untraceable, "cumsum"), (Branching, "an if on a channel")])
def test_what_has_no_counterpart_in_c_is_refused(
    effect: type[MeanEffect], what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for registry in (catalogue.CATALOGUE, catalogue.MEAN_EFFECTS):
        monkeypatch.setitem(registry, effect.name, effect)
    with pytest.raises(InputError, match=f"w.toml: effect {effect.name}: {what} has no counterpart in C"):
        friction_model(wheel_with(to_block(effect.typical())), "w.toml")


def test_bad_input_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    bare = Wheel.from_toml('[wheel]\nname = "bare"\nsample_period_s = 0.1\n', "bare")
    light = wheel_with(*blocks("load_dependence")).model_copy(update={"inertia_kg_m2": None})
    (tmp_path / "taken").write_text("a file")
    for wheel, out, words in (
        (bare, "out", "nominal: is missing; identify learns it from recordings"),
        (light, "out", "inertia_kg_m2: is missing; load_dependence follows the motor torque"),
        (wheel_with(), "taken", "is a file; a folder is needed here"),
    ):
        file = tmp_path / "wheel.toml"
        file.write_text(wheel.to_toml(), encoding="utf-8")
        result = run("export", file, "--to", "c", "-o", tmp_path / out)
        assert result.exit_code == 2
        assert words in result.stderr
        assert result.stderr.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"wheel.toml", "taken"}
    assert FORMATS.keys() >= {"c", "json"}


# ---- the onboard detector: the jumps of the monitor from a pipe, without exceptions or allocation --------------------


Jumps = list[tuple[int, float, float]]


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the detector of the built-in wheel; returns its folder."""
    folder = tmp_path_factory.mktemp("detector")
    for name, data in detector_files(friction_model(built_in_wheel(), "test")).items():
        (folder / name).write_bytes(data)
    subprocess.run(["make", "-s", "detector", f"DETECTOR_OUT={folder}"], check=True)
    return folder


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


def test_a_recordings_provisional_changepoints_are_printed(detector: Path, tmp_path: Path) -> None:
    """The recording's own messages, which the monitor wrote when it made the recording: slots, jumps and deviations."""
    messages = [message for recording in read_chain(Path("replay/nominal")) for message in recording.messages]
    attached = next(iter(read_chain(Path("replay/nominal")))).attachments
    shutil.copytree(detector, tmp_path, dirs_exist_ok=True)  # what is compiled there is of no wheel; the settings are
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
def test_a_full_window_of_any_noise_equals_the_monitors(heavy: bool, detector: Path) -> None:
    wheel, rng = built_in_wheel(), np.random.default_rng(3)
    n = wheel.window.samples
    speed = 200.0 + 80.0 * np.sin(np.arange(n) / 3000.0)
    noise = rng.standard_t(3, n) if heavy else rng.standard_normal(n)
    level = np.repeat(rng.choice([1.6e-3, 2.4e-3], n // 200 + 1), 200)[:n]
    friction = level + 5.3e-6 * speed + 3.9e-5 * noise
    friction[5000:5100] = np.nan
    jumps, given, used = piped(detector / "pipe", speed, friction)
    assert len(jumps) > 100
    assert jumps == monitored(wheel, speed, friction)
    assert used < given


def test_the_memory_suffices_for_the_most_peaks_there_can_be(detector: Path) -> None:
    """A jump every few slots fills the list of peaks, which is then pruned."""
    wheel, rng = built_in_wheel(), np.random.default_rng(4)
    n = wheel.window.samples
    speed = 200.0 + rng.normal(size=n)
    friction = np.where(np.arange(n) < 2000, 1.6e-3, rng.choice([1.6e-3, 4e-3, 9e-3], n)) + 3.9e-5 * rng.normal(size=n)
    jumps, given, used = piped(detector / "pipe", speed, friction)
    assert jumps == monitored(wheel, speed, friction)
    assert used < 0.8 * given


def test_the_library_demands_no_allocation_and_throws_nothing(detector: Path) -> None:
    names = subprocess.run(
        ["nm", "--undefined-only", detector / "librwa_detector.a"], capture_output=True, text=True, check=True
    ).stdout
    demanded = set(re.findall(r" U (\S+)", names))
    assert "sqrt" in demanded or "log" in demanded
    assert not demanded & {"malloc", "calloc", "realloc", "free", "__cxa_throw", "__cxa_begin_catch"}
    assert not [name for name in demanded if re.match(r"_Zn|_Zd", name)]  # operator new, operator delete


def test_a_wheel_whose_viscous_friction_follows_its_temperature_is_refused() -> None:
    warm = to_block(CATALOGUE["viscosity_temperature"].typical())
    with pytest.raises(InputError, match="viscosity_temperature changes its viscous friction"):
        detector_files(friction_model(built_in_wheel().model_copy(update={"effect": (warm,)}), "test"))
