"""A wheel learned from its recordings: the built-in wheel comes back; too little data is refused."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from rwa_monitor.batch.tasks import not_nominal
from rwa_monitor.cli.main import main
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.errors import InputError
from rwa_monitor.identification.identify import identify
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Anomaly, Scenario, Temperature
from rwa_monitor.telemetry.table import table_writer
from rwa_monitor.wheel.wheel import EffectBlock, Limits, Wheel, built_in_wheel
from tests.discrepancy.simple import sampled


def recordings(count: int, seed: int) -> list[tuple[str, Samples]]:
    """Simulate healthy recordings of the built-in wheel, 80,000 slots each."""
    scenarios = [Scenario(speed=SpeedProfile(kind=("orbit", "one_direction")[i % 2])) for i in range(count)]
    made = [simulate(one, built_in_wheel(), np.random.default_rng((seed, i))) for i, one in enumerate(scenarios)]
    return [(f"day_{i}.csv", one.samples) for i, one in enumerate(made)]


def test_nominal_friction_noise_and_both_switching_systems_come_back() -> None:
    true = built_in_wheel()
    learned = identify(recordings(10, seed=21), Wheel(name="learned", sample_period_s=0.125)).wheel
    assert learned.nominal.dry_torque_Nm == pytest.approx(true.nominal.dry_torque_Nm, rel=2e-3)
    assert learned.nominal.viscous_Nm_s_rad == pytest.approx(true.nominal.viscous_Nm_s_rad, rel=2e-3)
    assert learned.noise.friction_std_Nm == pytest.approx(true.noise.friction_std_Nm, rel=0.02)
    assert [system.configurations for system in learned.fss] == [2, 3]
    for system, true_system in zip(learned.fss, true.fss, strict=True):
        for law, true_law in zip(system.durations, true_system.durations, strict=True):
            # The mean of n sojourns of a uniform law is off by 0.58/√(3n) of its half-range at one sigma; 25 % of the
            # mean is beyond four sigma for the fewest (about 6) sojourns seen here.
            assert law.mean() == pytest.approx(true_law.mean(), rel=0.25)
        for found, stated in zip(system.friction, true_system.friction, strict=True):
            assert found.low == pytest.approx(stated.low, abs=0.08)
            assert found.high == pytest.approx(stated.high, abs=0.08)


def test_what_the_temperature_does_is_no_switching_system() -> None:
    """Viscous friction that falls by 2 % a kelvin over an orbit: the law is learned with the rest, or given."""
    block = EffectBlock(
        name="viscosity_temperature", parameters={"strength_Nm_s_rad": 5e-6, "activation_temperature_K": 1800.0}
    )
    scenario = Scenario(effect=(block,))
    samples = simulate(scenario, built_in_wheel(), np.random.default_rng(50_700)).samples
    bare = Wheel(name="warm", sample_period_s=0.125)
    without = identify([("warm.csv", samples)], bare, systems=False)
    known = identify([("warm.csv", samples)], bare.model_copy(update={"effect": (block,)}), systems=False)
    assert any(re.search("follows the bearing's temperature, -[0-9.]+ % a kelvin", note) for note in without.notes)
    assert not any("temperature" in note for note in known.notes)
    assert [one.name for one in without.wheel.effect] == ["viscosity_temperature"]
    assert known.wheel.effect == (block,)
    true = built_in_wheel().nominal
    for found in (without.wheel, known.wheel):
        assert found.nominal.viscous_Nm_s_rad == pytest.approx(true.viscous_Nm_s_rad, rel=3e-3)
        assert found.temperature.low_degC < np.min(samples.bearing_temperature_degC) + 0.5
        assert found.temperature.high_degC > np.max(samples.bearing_temperature_degC) - 0.5


ACTIVATION_K = 4300.0  # K, −5 % a kelvin at 20 °C


def learned_warm(temperature: bool = True) -> Wheel:
    """Learn a wheel without switching systems, its viscosity falling by 5 % a kelvin, from warm and cold recordings."""
    parameters = {"strength_Nm_s_rad": 5.333e-6, "activation_temperature_K": ACTIVATION_K, "sensor_lag_s": 600.0}
    effect = (EffectBlock(name="viscosity_temperature", parameters=parameters),)
    true = built_in_wheel().model_copy(update={"effect": effect, "fss": ()})
    channels = None if temperature else ("friction_torque_Nm", "motor_current_A")
    named = []
    for seed, at_degC in enumerate((8.0, 20.0, 32.0)):
        scenario = Scenario(temperature=Temperature(mean_degC=at_degC, swing_K=3.0), channels=channels)
        named.append((f"{at_degC:g} °C", simulate(scenario, true, np.random.default_rng([9, seed])).samples))
    return identify(named, Wheel(name="bare", sample_period_s=0.125), systems=False).wheel


def test_the_law_comes_back_with_the_range_it_holds_over() -> None:
    wheel = learned_warm()
    (law,) = wheel.effect
    assert law.name == "viscosity_temperature"
    assert law.parameters["activation_temperature_K"] == pytest.approx(ACTIVATION_K, rel=0.03)
    assert law.parameters["sensor_lag_s"] == pytest.approx(600.0, rel=0.1)
    assert wheel.nominal.viscous_Nm_s_rad == pytest.approx(5.333e-6, rel=0.01)
    assert 2.0 < wheel.temperature.low_degC < 8.0
    assert 32.0 < wheel.temperature.high_degC < 40.0


def test_without_the_channel_the_swing_is_learned_as_spread() -> None:
    wheel = learned_warm(temperature=False)
    assert wheel.effect == ()
    assert wheel.nominal.viscous_spread > 0.3  # ±12 K at 5 % a kelvin is a standard deviation of half


def test_a_single_jump_is_not_reported_as_a_switching_system() -> None:
    # One step of 10 standard deviations in a record of 250 s: it may be anything, and no number of recordings follows.
    samples, bare = in_levels([(900, 1.6), (1_100, 2.0)], 11), Wheel(name="step", sample_period_s=0.125)
    with pytest.raises(InputError, match="do not show that the wheel has such a system") as refused:
        identify([("step", samples)], bare)
    assert "times as many" not in str(refused.value)
    assert identify([("step", samples)], bare, systems=False).wheel.fss == ()


@pytest.mark.parametrize("systems", [True, False])
def test_a_minute_of_data_is_refused(systems: bool) -> None:
    name, samples = recordings(1, seed=5)[0]
    minute = samples[:500]
    with pytest.raises(InputError, match="too little data"):
        identify([(name, minute)], Wheel(name="minute", sample_period_s=0.125), systems=systems)


def test_recordings_may_differ_a_little_in_their_base_dry_friction() -> None:
    """Of the lowest one alone, the others would be called friction of a switching system."""
    rng = np.random.default_rng(50_150)
    shifted = []
    for name, samples in recordings(8, seed=50_150):
        shift_Nm = rng.normal(0.0, 0.02 * 1.6e-3) * np.sign(samples.speed_rad_s)
        shifted.append((name, replace(samples, friction_torque_Nm=samples.friction_torque_Nm + shift_Nm)))
    learned = identify(shifted, Wheel(name="bare", sample_period_s=0.125))
    # Eight recordings: a standard error of 0.7 %; the lowest of them lies 2.8 % below the mean on average.
    assert abs(learned.wheel.nominal.dry_torque_Nm / 1.6e-3 - 1.0) < 3.0 * 0.007
    assert len(learned.wheel.fss) == 2


def test_a_failing_wheel_s_drift_is_asked_about() -> None:
    failing = Scenario(
        speed=SpeedProfile(kind="orbit"), anomalies={"dry": Anomaly(factor=1.6, onset_s=2000.0, growth_s=40_000.0)}
    )
    samples = simulate(failing, built_in_wheel(), np.random.default_rng(8)).samples
    bare = Wheel(name="failing", sample_period_s=0.125)
    assert any("is the wheel healthy?" in note for note in identify([("f", samples)], bare, systems=False).notes)
    with pytest.raises(InputError, match="is the wheel healthy"):
        identify([("f", samples)], bare)


def test_healthy_recordings_are_not_reported_to_drift() -> None:
    for seed in range(5, 10):
        found = identify(recordings(1, seed=seed), Wheel(name="healthy", sample_period_s=0.125), systems=False)
        assert not any("drifts" in note for note in found.notes)


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_a_wheel_without_its_systems_is_not_called_anomalous_by_their_jumps(seed: int) -> None:
    # Friction of systems that the wheel file does not name is in the level: 2.4 mN m where the base is 1.6 mN m.
    found = recordings(1, seed=seed)
    wheel = identify(found, Wheel(name="bare", sample_period_s=0.125), systems=False).wheel
    (window,) = diagnose_samples(found[0][1], wheel, built_in_model())
    dry = window.diagnosis.anomalies["dry"]
    assert window.diagnosis.verdict == "inconclusive"
    assert not dry.active
    assert "inconclusive" in not_nominal(found, wheel)


def test_the_smallest_current_of_the_drive_is_learned_and_zero_is_then_no_reading() -> None:
    wheel = built_in_wheel()
    drive = wheel.model_copy(update={"limits": wheel.limits.model_copy(update={"min_current_A": 0.05})})

    def recording(seed: int, viscous: float = 1.0) -> Samples:
        failing = {"viscous": Anomaly(factor=viscous)}
        scenario = Scenario(friction_given=False, channels=("motor_current_A",), anomalies=failing)
        return simulate(scenario, drive, np.random.default_rng(seed)).samples

    limits = identify([("healthy", recording(7))], wheel, systems=False).wheel.limits
    assert limits == drive.limits
    for seed, viscous, verdict in ((1, 1.0, "nominal"), (1, 1.2, "anomalous"), (2, 1.0, "nominal")):
        known, unknown = (
            next(diagnose_samples(recording(seed, viscous), one, built_in_model())).diagnosis
            for one in (wheel.model_copy(update={"limits": limits}), wheel)
        )
        assert (known.verdict, known.model_adequate) == (verdict, True)
        assert not unknown.model_adequate


def in_levels(segments: list[tuple[int, float]], seed: int) -> Samples:
    """Return a recording whose dry friction stays at these levels [mN m], each so many slots, with white noise."""
    rng, period_s = np.random.default_rng(seed), 0.125
    level = np.concatenate([np.full(slots, 1e-3 * value) for slots, value in segments])
    at_s = np.arange(level.size) * period_s
    speed = 200.0 + 50.0 * np.sin(at_s / 400.0)
    return sampled(speed, level + 5.3e-6 * speed + rng.normal(0.0, 4e-5, level.size))


def test_a_configuration_seen_thrice_borrows_its_law_from_those_like_it() -> None:
    # The highest configuration is seen from begin to end three times, the others five and eight times; all last alike.
    lengths = np.random.default_rng(12).integers(1500, 4500, 19).tolist()
    levels = [2.4, 1.6, 2.4, 3.2, 2.4, 1.6, 2.4, 3.2, 2.4, 1.6, 2.4, 1.6, 2.4, 3.2, 2.4, 1.6, 2.4, 3.2, 2.4]
    segments = list(zip(lengths, levels, strict=True))
    (system,) = identify([("slow", in_levels(segments[:-1], 3))], Wheel(name="slow", sample_period_s=0.125)).wheel.fss
    for law in system.durations:
        # The means of 3000 are known to 0.29/√16, a fifteenth: 25 % is beyond three standard deviations.
        assert law.mean() == pytest.approx(3000.0, rel=0.25)


@pytest.mark.parametrize("place", ["jump", "begin", "end"])
def test_a_visit_that_is_not_undone_is_no_configuration(place: str) -> None:
    # Visits of ten slots (+0.5) beside a slow chain (+0.8, +1.6). One of them ends in the slot in which the chain goes
    # up: two jumps up in a row, which a chain of three configurations cannot make from its second. Or it is cut by an
    # end of the recording while the chain is at its highest.
    chain = [1.6, 2.4, 3.2, 2.4, 1.6, 2.4, 1.6, 2.4, 3.2, 2.4, 3.2, 2.4, 1.6, 2.4, 3.2, 2.4, 1.6, 2.4]
    segments: list[tuple[int, float]] = []
    for number, level in enumerate(chain):
        segments += [(700, level), (10, level + 0.5), (900, level), (10, level + 0.4), (800, level)]
        if number == 1 and place == "jump":
            segments.append((8, level + 0.45))
    if place == "begin":
        segments[:0] = [(8, 3.7), (900, 3.2), (900, 2.4)]
    if place == "end":
        segments += [(900, 3.2), (8, 3.7)]
    wheel = identify([("both", in_levels(segments, 4))], Wheel(name="both", sample_period_s=0.125)).wheel
    assert [system.configurations for system in wheel.fss] == [2, 3]


def test_command_writes_a_wheel_with_its_uncertainties(tmp_path: Path) -> None:
    _, samples = recordings(1, seed=5)[0]
    table = tmp_path / "day.csv"
    table_writer(table)(samples, table)
    output = tmp_path / "wheel.toml"
    arguments = ["identify", str(table), "--no-systems", "-o", str(output)]
    result = CliRunner().invoke(main, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    text = output.read_text()
    assert text.startswith("# learned from 1 recording")
    assert "±" in text
    assert tomllib.loads(text)["wheel"] == {"name": "day", "sample_period_s": 0.125}


@pytest.mark.parametrize(("dry", "viscous"), [(2.0, 1.0), (1.0, 2.0)])
def test_no_wheel_is_written_that_calls_its_own_recordings_anomalous(
    tmp_path: Path, dry: float, viscous: float
) -> None:
    tables = [tmp_path / "one.csv", tmp_path / "other.csv"]
    for seed, (path, times) in enumerate(zip(tables, ((1.0, 1.0), (dry, viscous)), strict=True)):
        rng = np.random.default_rng(seed)
        speed = 150.0 + 100.0 * np.sin(2 * np.pi * np.arange(20_000) / 4800.0)
        friction = times[0] * 1.6e-3 + times[1] * 5.3e-6 * speed + 3.9e-5 * rng.normal(size=speed.size)
        table_writer(path)(sampled(speed, friction), path)
    output = tmp_path / "wheel.toml"
    result = CliRunner().invoke(main, ["identify", *map(str, tables), "--no-systems", "-o", str(output)])
    assert result.exit_code == 2
    assert "windows that it was learned from anomalous" in result.output
    assert not output.exists()


def in_motion(**changes: float) -> tuple[list[tuple[str, Samples]], Wheel]:
    """1000 s of one healthy wheel that swings between 30 and 270 rad/s, by its current; factors change channels."""
    wheel = built_in_wheel().model_copy(update={"nominal": None, "fss": (), "limits": Limits()})
    rng = np.random.default_rng(50020)
    time = np.arange(8000) * 0.125
    speed = 150.0 + 100.0 * np.sin(2 * np.pi * time / 600.0) + 20.0 * np.sin(2 * np.pi * time / 130.0)
    friction = 1.6e-3 + 5.3e-6 * speed + 3.9e-5 * rng.normal(size=time.size)
    torque = changes.get("friction", 1.0) * friction + changes.get("inertia", 1.0) * wheel.inertia_kg_m2 * np.gradient(
        speed, 0.125
    )
    current = changes.get("current", 1.0) * torque / wheel.torque_constant_Nm_A
    return [("x.csv", sampled(changes.get("speed", 1.0) * speed, motor_current_A=current))], wheel


@pytest.mark.parametrize(
    ("changes", "question"),
    [
        ({"speed": 30.0 / np.pi}, r"speed_rad_s: .* 0\.10\d+ times inertia_kg_m2 .* in rpm\?"),
        ({"speed": np.pi / 30.0}, r"speed_rad_s: .* converted twice from rpm\?"),
        ({"current": -1.0}, r"motor_current_A: .* -1\.?\d* times inertia_kg_m2 .* of the opposite sign\?"),
        ({"speed": 180.0 / np.pi}, r"speed_rad_s: .* in degrees per second\?"),
        ({"current": 1000.0}, r"motor_current_A: .* in mA\?"),
        ({"friction": -1.0}, "is the sign of speed or torque right"),
        ({"inertia": 0.6}, r"follows the acceleration .* inertia_kg_m2 = 0\.0117"),
        ({"inertia": 0.9}, r"follows the acceleration .* inertia_kg_m2 = 0\.0117"),
    ],
)
def test_what_is_asked_is_what_is_wrong(changes: dict[str, float], question: str) -> None:
    recordings, wheel = in_motion(**changes)
    with pytest.raises(InputError, match=question):
        identify(recordings, wheel, systems=False)


def test_nothing_is_asked_where_all_is_right() -> None:
    recordings, wheel = in_motion()
    learned = identify(recordings, wheel, systems=False)
    assert learned.wheel.nominal.viscous_Nm_s_rad == pytest.approx(5.3e-6, rel=0.02)
    assert not any("?" in note for note in learned.notes)


def test_a_slope_in_another_unit_is_asked_about_where_a_nominal_one_is_known() -> None:
    recordings, wheel = in_motion()
    known = wheel.model_copy(update={"nominal": built_in_wheel().nominal})
    ((name, samples),) = recordings
    friction = 1.6e-3 + 5.3e-6 * samples.speed_rad_s
    friction += 3.9e-5 * np.random.default_rng(50022).normal(size=friction.size)
    for factor, asked in ((1.0, False), (30.0 / np.pi, True)):
        notes = identify([(name, sampled(factor * samples.speed_rad_s, friction))], known, systems=False).notes
        assert any("is speed_rad_s in rpm?" in note for note in notes) is asked


@pytest.mark.parametrize("seed", range(50021, 50025))  # the slope that noise makes has either sign
def test_at_one_speed_only_the_sum_is_reported(seed: int) -> None:
    _, wheel = in_motion()
    rng = np.random.default_rng(seed)
    still = sampled(300.0 + 0.01 * rng.normal(size=8000), 3.2e-3 + 3.9e-5 * rng.normal(size=8000))
    with pytest.raises(InputError, match=r"hardly leaves 300 rad/s: there friction is 0\.0032\d* N m"):
        identify([("still.csv", still)], wheel, systems=False)


def test_what_is_missing_is_reported_in_hours() -> None:
    # Three visits of 2000 slots, where four are needed.
    segments = [(2000, 1.6 + 0.8 * (number % 2)) for number in range(7)]
    with pytest.raises(InputError, match=r"give about \d times as many recordings, [\d.]+ h in all") as refused:
        identify([("few", in_levels(segments, 5))], Wheel(name="few", sample_period_s=0.125))
    assert "…" not in str(refused.value)
