"""The exported FMU in FMPy: valid, equal to the package's own simulation both ways, its state can be put back."""

import re
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from rwa_monitor.export import FORMATS
from rwa_monitor.export.model import INPUTS, friction_model
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, to_block
from rwa_monitor.wheel.wheel import Wheel
from tests.export.script import STRICT, Script, largest_difference, simulated, wheel_with
from tests.program import run

EQUAL_WITHIN = 1e-9  # relative, of each sample: the demand
HEADERS = Path(fmpy.__file__).parent / "c-code"
OUTPUT = "friction_torque_Nm"


@pytest.fixture(scope="module")
def wheel() -> Wheel:
    held = [effect for effect in CATALOGUE.values() if not effect.not_exported]
    changed = wheel_with(*(to_block(effect.typical()) for effect in held))
    return changed.model_copy(update={"name": '<a> & "b"'})


@pytest.fixture(scope="module")
def script(wheel: Wheel) -> Script:
    return simulated(wheel)


@pytest.fixture(scope="module")
def fmu(wheel: Wheel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fmu")
    (folder / "wheel.toml").write_text(wheel.to_toml(), encoding="utf-8")
    assert run("export", folder / "wheel.toml", "--to", "fmu", "-o", folder / "out").exit_code == 0
    return folder / "out" / "rwa_friction.fmu"


def simulate(fmu: Path, script: Script, kind: str) -> FloatArray:
    """Let FMPy simulate the whole script; return its output at each of its times."""
    time = np.arange(len(script.inputs)) * script.period_s
    signals = np.rec.fromarrays([time, *script.inputs.T], names=["time", *INPUTS, "dry_level_Nm"])
    step = {"step_size": script.period_s} if kind == "ModelExchange" else {}
    span = {"start_time": 0.0, "stop_time": time[-1], "output_interval": script.period_s, **step}
    how = {"fmi_type": kind, "solver": "Euler", "record_events": False}
    result = fmpy.simulate_fmu(str(fmu), input=signals, output=[OUTPUT], **span, **how)
    assert np.array_equal(result["time"], time)
    return np.asarray(result[OUTPUT])


def test_the_validator_finds_nothing(fmu: Path) -> None:
    assert validate_fmu(str(fmu)) == []
    description = fmpy.read_model_description(str(fmu))
    assert [v.name for v in description.modelVariables if v.causality == "input"] == list(INPUTS)
    assert [v.name for v in description.modelVariables if v.causality == "output"] == [OUTPUT]
    assert description.modelName == '<a> & "b"'


def test_co_simulation_equals_the_simulation(fmu: Path, script: Script) -> None:
    torque = simulate(fmu, script, "CoSimulation")
    # FMPy reads the output at the end of a step, which holds the inputs of its begin.
    held = np.append(script.torque_Nm[0], script.torque_Nm[:-1])
    assert largest_difference(torque, held) < EQUAL_WITHIN


def test_model_exchange_equals_the_simulation(fmu: Path, script: Script) -> None:
    assert largest_difference(simulate(fmu, script, "ModelExchange"), script.torque_Nm) < EQUAL_WITHIN


@pytest.fixture
def slave(fmu: Path) -> Iterator[FMU3Slave]:
    description = fmpy.read_model_description(str(fmu))
    name = description.coSimulation.modelIdentifier
    one = FMU3Slave(
        guid=description.guid, unzipDirectory=fmpy.extract(str(fmu)), modelIdentifier=name, instanceName="one"
    )
    one.instantiate()
    one.enterInitializationMode()
    one.exitInitializationMode()
    yield one
    one.terminate()
    one.freeInstance()


def steps(slave: FMU3Slave, script: Script, start: int, stop: int) -> FloatArray:
    """Step with an importer that sets the inputs and reads the output before each step."""
    torque = []
    for k in range(start, stop):
        slave.setFloat64([1, 2, 3, 4, 5], script.inputs[k].tolist())
        torque += slave.getFloat64([6])
        slave.doStep(k * script.period_s, script.period_s)
    return np.array(torque)


def test_an_input_passes_straight_to_the_output(slave: FMU3Slave, script: Script) -> None:
    assert largest_difference(steps(slave, script, 0, 20_000), script.torque_Nm[:20_000]) < EQUAL_WITHIN


def test_a_state_that_is_put_back_goes_on_as_before(slave: FMU3Slave, script: Script) -> None:
    beginning = steps(slave, script, 0, 12_000)[:1000]
    state = slave.getFMUState()
    content = slave.serializeFMUState(state)
    first = steps(slave, script, 12_000, 13_000)
    slave.setFMUState(state)
    assert np.array_equal(steps(slave, script, 12_000, 13_000), first)
    slave.freeFMUState(state)
    again = slave.deserializeFMUState(content)
    slave.setFMUState(again)
    assert np.array_equal(steps(slave, script, 12_000, 13_000), first)
    slave.freeFMUState(again)
    slave.reset()
    assert np.array_equal(steps(slave, script, 0, 1000), beginning)


def test_what_is_no_variable_is_refused(slave: FMU3Slave) -> None:
    for wrong in ([6], [7]):
        with pytest.raises(Exception, match="fmi3SetFloat64"):
            slave.setFloat64(wrong, [1.0])
    with pytest.raises(Exception, match="fmi3GetFloat64"):
        slave.getFloat64([7])


def test_the_sources_compile_strictly_against_the_standards_own_header(fmu: Path, wheel: Wheel, tmp_path: Path) -> None:
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path)
    sources = tmp_path / "sources"
    for name, content in FORMATS["c"](friction_model(wheel, "")).items():
        assert (sources / name).read_bytes() == content
    header = ["-include", str(HEADERS / "fmi3Functions.h"), "-I", str(HEADERS)]
    listed = re.findall(r'SourceFile name="(.*)"', (sources / "buildDescription.xml").read_text(encoding="utf-8"))
    assert {f"{name}" for name in listed} == {file.name for file in sources.glob("*.c")}
    for options in (header, []):
        subprocess.run(["gcc", *STRICT, *options, "-c", "rwa_fmi3.c", "-o", "fmi.o"], cwd=sources, check=True)
    # Every function of the standard is there.
    wanted = set(re.findall(r"TYPE\s+(fmi3\w+);", (HEADERS / "fmi3Functions.h").read_text(encoding="utf-8")))
    (binary,) = (tmp_path / "binaries").glob("*-linux/rwa_friction.so")
    symbols = subprocess.run(["nm", "-D", "--defined-only", binary], capture_output=True, text=True, check=True).stdout
    assert set(re.findall(r" T (\w+)", symbols)) == wanted
    assert len(wanted) == 75


def test_the_same_wheel_gives_the_same_bytes(fmu: Path, wheel: Wheel) -> None:
    assert FORMATS["fmu"](friction_model(wheel, "")) == {"rwa_friction.fmu": fmu.read_bytes()}


def test_without_a_compiler_it_names_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "wheel.toml").write_text(wheel_with().to_toml(), encoding="utf-8")
    for compiler, code, words in (
        ("no-such-compiler", 2, "--to fmu: needs a C compiler (cc, or $CC): apt-get install gcc; --to c needs none"),
        ("false", 1, "--to fmu: false fails"),
    ):
        monkeypatch.setenv("CC", compiler)
        result = run("export", tmp_path / "wheel.toml", "--to", "fmu", "-o", tmp_path / "out")
        assert result.exit_code == code
        assert words in result.stderr
        assert result.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
