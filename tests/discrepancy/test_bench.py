"""Records of test benches: a motor that is off, tables of a few dozen rows, clocks that do not tick evenly."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from rwa_monitor.batch.tasks import not_nominal
from rwa_monitor.discrepancy.bench import MEAN_OF_A_TURN, SCALED_ONLY, as_measured, is_even, with_turns
from rwa_monitor.discrepancy.extended import extended_wheel
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.hypotheses import NOT_COMMANDED
from rwa_monitor.discrepancy.plausible import implied_inertia
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.errors import InputError
from rwa_monitor.identification.identify import identify
from rwa_monitor.reporting import figures
from rwa_monitor.reporting.residual_views import all_views
from rwa_monitor.samples import Samples, concatenate
from rwa_monitor.telemetry.table import read_table
from rwa_monitor.wheel.torque_balance import torque_per_ampere
from rwa_monitor.wheel.wheel import Derivative, FrictionFilter, Wheel
from tests.discrepancy.simple import Array, names

OFF = FrictionFilter(motor_off=True)
WINDAGE = 8e-4  # N m s²/rad²


def drag(speed: Array, windage: float) -> Array:
    return 0.02 + 0.002 * speed + windage * speed**2


INERTIA = 1.8  # kg m²


def run_down_by_turns(windage: float, angle: Array) -> tuple[Array, Array]:
    """Return time and speed at angles [rad] of a wheel that runs down from 20 to 2 rad/s."""
    slow = lambda _, y: y[1] - 2.0  # noqa: E731
    slow.terminal = True
    slopes = lambda _, y: [1.0 / y[1], -drag(y[1], windage) / (INERTIA * y[1])]  # noqa: E731
    span = min(angle[0], 0.0), angle[-1]
    time, speed = solve_ivp(slopes, span, [0.0, 20.0], t_eval=angle, events=slow, rtol=1e-10, atol=1e-12).y
    return time, speed


def turns(windage: float) -> tuple[Array, Array]:
    """Return time and speed of such a wheel, a row a turn."""
    time, speed = run_down_by_turns(windage, 2 * np.pi * np.arange(3000))
    return time, speed * (1 + 1e-4 * np.random.default_rng(0).normal(size=time.size))


def slowed(drag_at: Callable[[float], float], step_s: float, slowest: float) -> tuple[Array, Array]:
    """Return time and speed of a wheel of 5 kg m² from 20 rad/s down to a slowest one, in steps of time."""
    fine = [20.0]
    while fine[-1] > slowest:
        fine.append(fine[-1] - step_s / 5.0 * float(drag_at(fine[-1])))
    return step_s * np.arange(len(fine)), np.array(fine)


def run_down(windage: float, uneven: float = 0.0, period_s: float = 0.5, seed: int = 0) -> Samples:
    """Return time and speed of such a wheel down to about 2 rad/s, steps uneven by so much of the period."""
    rng, fine = np.random.default_rng(seed), slowed(lambda speed: drag(speed, windage), 0.05, 2.0)
    count = int(0.05 * fine[0].size / period_s * 0.95)
    time = np.cumsum(period_s * (1 + uneven * rng.uniform(-1, 1, count)))
    return samples(time, np.interp(time, *fine) + 1e-4 * rng.normal(size=count))


def swing(time: Array) -> tuple[Array, Array, Array]:
    """Return speed, friction and accelerating torque of a wheel of 0.5 kg m² that never rests."""
    speed = 11.0 + 9.0 * np.sin(0.2 * time)
    return speed, drag(speed, WINDAGE), 0.5 * 1.8 * np.cos(0.2 * time)


def samples(time_s: Array, speed: Array, friction: Array | None = None, **channels: Array) -> Samples:
    return Samples((time_s * 1e9).astype(np.int64), speed, friction, **channels)


def bench(inertia: float | None = 5.0, period_s: float = 0.5) -> Wheel:
    return Wheel(name="bench", sample_period_s=period_s, inertia_kg_m2=inertia, friction=OFF)


@pytest.mark.parametrize("uneven", [0.0, pytest.param(0.1, marks=pytest.mark.slow), 0.5])
def test_a_wheel_with_its_motor_off_shows_its_drag_from_time_and_speed_alone(uneven: float) -> None:
    assert names(find_discrepancy([("coast", run_down(0.0, uneven, 1.0))], bench(period_s=1.0))) == []
    search = find_discrepancy([("coast", run_down(WINDAGE, uneven))], bench())
    assert names(search) == ["quadratic_drag"]
    strength = search.result.effects[0].parameters["strength_Nm_s2_rad2"]
    assert abs(strength.value - WINDAGE) < 4 * strength.std
    untested = dict(search.result.untested)
    for name in ("inertia_error", "torque_constant_error", "current_delay"):
        assert SCALED_ONLY in untested[name]


def test_the_report_of_a_short_run_down_has_no_empty_picture() -> None:
    coast = run_down(WINDAGE)
    search = find_discrepancy([("coast", coast[: len(coast) // 90 * 90 : len(coast) // 90])], bench())
    assert 60 < search.problem.size < 100
    axis = figures.friction_over_speed(search).axes[0]
    assert max(np.size(bars.lines[0].get_xdata()) for bars in axis.containers) > 10
    assert len(figures.gains_picture(search).axes) == 1  # none for jumps, as there are none
    assert all(view.base.x.size for view in all_views(search.problem, search.base, search.extended))


def test_without_motor_no_curve_over_the_acceleration_explains_its_own_multiple() -> None:
    fine = slowed(lambda speed: drag(speed, 0.0) + 0.01 * np.sin(speed / 2.0), 0.01, 1.0)
    time = np.arange(0.0, 0.01 * fine[0].size, 0.5)
    speed = np.interp(time, *fine) + 1e-4 * np.random.default_rng(0).normal(size=time.size)
    result = find_discrepancy([("coast", samples(time, speed))], bench()).result
    assert result.unexplained.signature == "a drag that depends on |speed|"


def test_without_motor_a_drag_that_wanders_is_not_one_of_the_acceleration() -> None:
    """Its noise is that of the acceleration, from which it comes, whether the clock is even or not."""
    rng, wander = np.random.default_rng(0), [0.0]

    def wandering(speed: float) -> float:
        wander.append(0.998 * wander[-1] + 3e-4 * rng.normal())
        return drag(speed, 0.0) + wander[-1]

    fine = slowed(wandering, 0.01, 1.0)
    time = np.arange(0.0, 0.01 * fine[0].size, 0.5)
    time[1:] += 0.25 * rng.uniform(-1.0, 1.0, time.size - 1)
    speed = np.interp(time, *fine) + 1e-4 * rng.normal(size=time.size)
    assert find_discrepancy([("coast", samples(time, speed))], bench()).result.verdict == "adequate"


def test_a_run_down_within_the_usual_window_of_the_derivative_is_read_with_a_shorter_one() -> None:
    time, friction = 0.01 * np.arange(160), 0.04 * np.ones(160)  # 1.6 s
    speed = 40.0 - np.cumsum(friction) * 0.01 / 0.005 + 1e-3 * np.random.default_rng(5).normal(size=160)
    table, wheel = [("short", samples(time, speed))], bench(0.005, 0.01)
    made = as_measured(table, wheel)
    assert made.wheel.friction.derivative.window_s == pytest.approx(0.159)
    assert np.count_nonzero(make_record(made.recordings[0][1], made.wheel, "short").used) > 130
    stated = FrictionFilter(derivative=Derivative(window_s=2.0), motor_off=True)
    assert as_measured(table, wheel.model_copy(update={"friction": stated})).wheel.friction == stated


def commanded(torque: Array, speed: Array) -> Search:
    """Search for what is missing where the torque was commanded, one row each half second."""
    ramp = samples(0.5 * np.arange(torque.size), speed, torque)
    return find_discrepancy([("ramp", ramp)], Wheel(name="bench", sample_period_s=0.5))


def test_what_was_commanded_is_a_ramp_over_time_to_the_last_digit_and_no_drift() -> None:
    torque = 0.05 + 0.005 * np.arange(240)
    speed = (-0.002 + np.sqrt(0.002**2 + 4 * WINDAGE * (torque - 0.02))) / (2 * WINDAGE)
    search = commanded(torque, speed + 0.05 * np.random.default_rng(0).normal(size=torque.size))
    assert names(search) == ["quadratic_drag"]
    assert search.result.unexplained is None
    assert dict(search.result.untested)["run_in_drift"] == NOT_COMMANDED


def test_what_was_commanded_does_not_wander() -> None:
    """All noise is in the speed: a slope of next to nothing and a level that wanders would fit, too."""
    torque = np.append(np.arange(-255.0, -8.0), np.arange(9.0, 256.0))
    speed = np.sign(torque) * (np.abs(torque) - 4.0) / 5.0
    search = commanded(torque, speed + np.random.default_rng(1).normal(size=torque.size))
    assert search.result.verdict == "adequate"
    assert search.base.fit.coefficients[0] == pytest.approx(5.0, rel=0.02)


def test_an_even_clock_that_loses_every_seventh_sample_is_read_by_its_own_times() -> None:
    whole = run_down(WINDAGE, period_s=0.05)
    lossy = whole[np.random.default_rng(2).random(len(whole)) > 1 / 7]
    assert is_even(lossy.time_ns)
    made = as_measured([("lossy", lossy)], bench(period_s=0.05))
    assert np.count_nonzero(make_record(made.recordings[0][1], made.wheel, "lossy").used) > 0.9 * len(lossy)


def test_without_an_inertia_a_run_down_is_refused_with_its_name() -> None:
    with pytest.raises(InputError, match="inertia_kg_m2"):
        find_discrepancy([("coast", run_down(WINDAGE))], bench(None))


@pytest.mark.parametrize("windage", [WINDAGE, 1e-4])  # with less, dry friction is not negative, but uncertain
def test_windage_is_a_missing_law_to_identify_not_an_inertia(windage: float) -> None:
    with pytest.raises(InputError, match=r"drag bends upwards over the speed, as windage .* a law is missing"):
        identify([("coast", run_down(windage))], bench(), systems=False)


@pytest.mark.parametrize("windage", [5e-5, 0.0])
def test_a_little_windage_is_said_and_none_is_not(windage: float) -> None:
    notes = identify([("coast", run_down(windage))], bench(), systems=False).notes
    assert any("a law is missing" in note for note in notes) is (windage > 0)


def test_with_the_law_that_was_missing_the_wheel_is_learned() -> None:
    recordings = [("coast", run_down(WINDAGE))]
    learned = identify(recordings, extended_wheel(find_discrepancy(recordings, bench())), systems=False).wheel
    assert learned.nominal.dry_torque_Nm == pytest.approx(0.02, rel=0.01)
    assert learned.nominal.viscous_Nm_s_rad == pytest.approx(0.002, rel=0.01)
    assert not_nominal(recordings, learned) == ""


@pytest.mark.parametrize("rows", [40, 60, 84, 120, 175])
@pytest.mark.parametrize("ladder", [False, True])
def test_short_tables_name_windage(rows: int, ladder: bool) -> None:
    dwells = np.repeat(np.linspace(5.0, 100.0, 8), 22)[:: max(176 // rows, 1)]
    speed = dwells[:rows] if ladder else np.linspace(100.0, 5.0, rows)
    windage, plain = 1e-6 * speed**2, 2e-4 * (1.0 + speed / 100.0)
    noise = 0.01 * float(np.mean(plain + windage)) * np.random.default_rng(rows).normal(size=speed.size)
    wheel, time = Wheel(name="short", sample_period_s=0.1), 0.1 * np.arange(speed.size)
    search = find_discrepancy([("short", samples(time, speed, plain + windage + noise))], wheel)
    assert names(search) == ["quadratic_drag"]
    assert search.result.effects[0].equivalent == ()
    null = find_discrepancy([("short", samples(time, speed, plain + noise))], wheel).result
    assert null.verdict == "adequate"
    assert dict(null.untested)["coloured_noise"] == "200 samples or more"


@pytest.mark.parametrize("windage", [WINDAGE, 0.0])
def test_friction_given_once_a_turn_is_read_as_it_is(windage: float) -> None:
    time, speed = turns(windage)
    assert np.diff(time).max() > 5 * np.diff(time).min()
    friction = drag(speed, windage)
    friction = friction + 0.01 * friction.mean() * np.random.default_rng(1).normal(size=speed.size)
    table = samples(time, speed, friction)
    search = find_discrepancy([("turns", table)], Wheel(name="on", sample_period_s=0.125))
    assert names(search) == (["quadratic_drag"] if windage else [])
    assert search.result.unexplained is None
    assert "coloured_noise" not in dict(search.result.untested)


def test_uneven_current_is_interpolated_and_it_is_said() -> None:
    rng = np.random.default_rng(0)
    time = np.cumsum(0.1 * (1 + 0.3 * rng.uniform(-1, 1, 3000)))
    time[2000:] += 3.0  # nothing is filled in over a gap
    speed, friction, slew = swing(time)
    table = samples(time, speed, motor_torque_Nm=slew + friction + 1e-3 * rng.normal(size=3000))
    wheel = Wheel(name="on", sample_period_s=0.1, inertia_kg_m2=0.5)
    made = as_measured([("log", table)], wheel)
    (_, even), (note,) = made.recordings[0], made.notes
    assert "3000 rows are interpolated" in note
    assert is_even(even.time_ns)
    assert 25 < np.count_nonzero(np.isnan(even.speed_rad_s)) < 35
    assert names(find_discrepancy([("log", table)], wheel)) == ["quadratic_drag"]


def test_torque_is_not_interpolated_over_a_reversal() -> None:
    rng = np.random.default_rng(26)
    time = 0.125 * np.flatnonzero(rng.random(4000) > 0.12)  # every eighth sample is lost
    speed = 140.0 * np.sin(time / 15.0) + 60.0 * np.sin(time / 4.0)
    torque = 0.01 * np.gradient(speed, time) + 2e-3 * np.sign(speed) + 1e-5 * speed
    log = samples(time, speed, motor_torque_Nm=torque + 1e-4 * rng.normal(size=time.size))
    (_, even), *_ = as_measured([("log", log)], Wheel(name="on", sample_period_s=0.125, inertia_kg_m2=0.01)).recordings
    lost = np.isfinite(even.speed_rad_s) & np.isnan(even.motor_torque_Nm)
    assert 0 < np.count_nonzero(lost) < 10
    assert np.all(np.abs(even.speed_rad_s[lost]) < 5.0)


@pytest.mark.parametrize("given", [False, True])
def test_a_table_faster_than_the_wheel_files_period_is_read_by_its_own(given: bool) -> None:
    rng, time = np.random.default_rng(0), 0.1 * np.arange(3000)
    speed, friction, slew = swing(time)
    friction = friction + 1e-3 * rng.normal(size=time.size)
    table = samples(time, speed, friction) if given else samples(time, speed, motor_torque_Nm=slew + friction)
    wheel = Wheel(name="on", sample_period_s=1.0, inertia_kg_m2=0.5)
    made = as_measured([("log", table)], wheel)
    assert made.wheel.sample_period_s == pytest.approx(0.1)
    assert made.notes == ["log: time steps of 0.1 s are not the wheel's sample_period_s: they are used in its place"]
    found = find_discrepancy([("log", table)], wheel)
    assert names(found)[0] == "quadratic_drag"
    assert found.problem.size > 2900


def test_a_slope_of_the_speed_reaches_over_no_more_than_a_log_is_whole() -> None:
    time = 0.02 * np.arange(3000)
    speed, friction, slew = swing(time)
    torque = slew + friction + 1e-3 * np.random.default_rng(0).normal(size=3000)
    table = samples(time, speed, motor_torque_Nm=torque)[np.arange(3000) % 90 < 80]
    wheel = Wheel(name="log in pieces", sample_period_s=0.02, inertia_kg_m2=0.5)  # its window would be of 101 samples
    assert names(find_discrepancy([("log", table)], wheel)) == ["quadratic_drag"]


def slipping(seed: int = 0, rows: int = 4000) -> tuple[Samples, Array]:
    """Return samples with a ripple at three a turn of a shaft that slips at every fourth row or so, and its angle."""
    rng, fine = np.random.default_rng(seed), 50  # the wheel makes five turns from row to row
    swept = 30.0 + 12.0 * np.sin(2 * np.pi * np.arange(rows * fine) / fine / 700.0)
    turned = np.append(0.0, np.cumsum(0.5 * (swept[1:] + swept[:-1]) / fine))[::fine]
    angle = turned - np.cumsum((rng.random(rows) < 1 / 4) * rng.uniform(-np.pi, np.pi, rows))
    speed = swept[::fine]
    friction = 1.6e-3 + 5e-6 * speed + 2e-4 * np.cos(3 * angle + 0.7) + 4e-5 * rng.normal(size=rows)
    return samples(np.arange(rows), speed + 0.02 * rng.normal(size=rows), friction), angle


@pytest.mark.parametrize("within_a_turn", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_measured_angle_finds_the_ripple_that_the_speed_has_lost(within_a_turn: bool) -> None:
    table, angle = slipping()
    wheel = Wheel(name="slips", sample_period_s=1.0)
    blind = find_discrepancy([("integrated", table)], wheel).result.gain
    assert blind.rmse_extended_Nm > 0.9 * blind.rmse_base_Nm
    given = np.mod(angle, 2 * np.pi) if within_a_turn else angle
    given[np.random.default_rng(1).integers(0, len(table), 40)] = np.nan
    search = find_discrepancy([("measured", replace(table, angle_rad=given))], wheel)
    assert names(search) == ["torque_ripple"]
    found = search.result.effects[0].parameters
    assert found["harmonic"].value == 3.0
    gain = search.result.gain
    assert gain.rmse_extended_Nm == pytest.approx(4e-5, rel=0.05)
    for name, hidden in (("strength_cos_Nm", 2e-4 * np.cos(0.7)), ("strength_sin_Nm", -2e-4 * np.sin(0.7))):
        std = found[name].std
        assert abs(found[name].value - hidden) < 4 * std
        assert std < 2e-6


@given(turns=st.integers(-3, 3), start=st.floats(0.0, 6.28), seed=st.integers(0, 99))
def test_the_turns_of_an_angle_are_counted(turns: int, start: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.5, 1.5, 50))
    speed = 20.0 * np.sin(time / 20.0)
    steps = 0.5 * np.diff(time) * (speed[1:] + speed[:-1])
    angle = start + 2 * np.pi * turns + np.append(0.0, np.cumsum(steps + rng.uniform(-0.5, 0.5, 49)))
    table = replace(samples(time, speed), angle_rad=np.mod(angle, 2 * np.pi))
    counted = with_turns(table, "log").angle_rad
    np.testing.assert_allclose(np.diff(counted), np.diff(angle), atol=1e-6)
    assert with_turns(replace(table, angle_rad=counted), "log").angle_rad == pytest.approx(counted, abs=1e-6)


def test_an_angle_in_degrees_is_refused_with_its_column() -> None:
    table, angle = slipping()
    for wrong in (np.degrees(angle), np.mod(np.degrees(angle), 360.0), 5.0 * angle):
        with pytest.raises(InputError, match=r"log: angle_rad: covers .* is the column angle_deg"):
            find_discrepancy([("log", replace(table, angle_rad=wrong))], Wheel(name="slips", sample_period_s=1.0))


def test_an_uneven_angle_is_interpolated_over_the_end_of_a_turn() -> None:
    rng = np.random.default_rng(0)
    time = np.cumsum(0.1 * (1 + 0.3 * rng.uniform(-1, 1, 2000)))
    speed, angle = np.full(2000, 20.0), 20.0 * time
    table = samples(time, speed, motor_torque_Nm=np.ones(2000), angle_rad=np.mod(angle, 2 * np.pi))
    ((_, even),) = as_measured([("log", table)], Wheel(name="on", sample_period_s=0.1)).recordings
    np.testing.assert_allclose(np.diff(even.angle_rad), 2.0, atol=1e-6)


GEARED = Wheel(name="geared", sample_period_s=0.1, inertia_kg_m2=5.0, torque_constant_Nm_A=0.05, gear_ratio=24.0)


def geared(efficiency: float = 1.0, offset_A: float = 0.0) -> Samples:
    """Return speed and motor current of a wheel of 5 kg m² behind a gear of 24, a motor of 0.05 N m/A."""
    rng = np.random.default_rng(0)
    time = 0.1 * np.arange(6000)
    swings = ((12.0, 100.0), (2.5, 41.0))  # rad/s, s
    speed = 3.0 + sum(top * np.sin(2 * np.pi * time / period) for top, period in swings)
    slew = sum(top * 2 * np.pi / period * np.cos(2 * np.pi * time / period) for top, period in swings)
    dry = np.where(time < 300.0, 0.3, 0.5)  # at one level an offset is the same as dry friction of one direction
    torque = 5.0 * slew + dry * np.sign(speed) + 0.05 * speed
    of_motor = torque / 24.0 * np.where(torque * speed > 0, 1 / efficiency, efficiency)
    current = of_motor / 0.05 + offset_A + 0.005 * rng.normal(size=time.size)
    return samples(time, speed + 1e-4 * rng.normal(size=time.size), motor_current_A=current)


def test_behind_a_gear_inertia_friction_and_offset_are_the_wheels() -> None:
    table = geared(offset_A=0.02)
    search = find_discrepancy([("log", table)], GEARED)
    assert names(search) == ["torque_bias"]
    bias = search.result.effects[0].parameters["strength_Nm"]
    assert abs(bias.value - 0.02 * 0.05 * 24.0) < 4 * bias.std
    assert search.extended.fit.coefficients[0] == pytest.approx(0.05, rel=0.01)
    assert search.extended.fit.level[[0, -1]] == pytest.approx([0.3, 0.5], rel=0.02)
    per_ampere = torque_per_ampere(table.motor_current_A, table.speed_rad_s, GEARED)
    shown = implied_inertia(table.speed_rad_s, per_ampere * table.motor_current_A, 0.1)
    assert shown.value == pytest.approx(5.0, rel=0.01)


def test_the_loss_of_a_gear_is_none_of_the_wheels_friction() -> None:
    known = find_discrepancy([("log", geared(0.8))], GEARED.model_copy(update={"gear_efficiency": 0.8}))
    # The current's noise counts more at the wheel while that drives the motor: two widths, as of heavy tails.
    assert set(names(known)) <= {"heavy_tailed_noise"}
    assert known.result.unexplained is None
    assert known.extended.fit.level[[0, -1]] == pytest.approx([0.3, 0.5], rel=0.02)
    assert "load_dependence" in names(find_discrepancy([("log", geared(0.8))], GEARED))


def pulse_times(windage: float, per_turn: int) -> Array:
    """Return when such a wheel gives its pulses, one less and one more."""
    rng = np.random.default_rng(per_turn)
    marks = np.arange(per_turn) / per_turn + 0.02 / per_turn * rng.uniform(-1, 1, per_turn)
    angle = 2 * np.pi * (np.arange(350)[:, None] + marks).ravel()
    run, _ = run_down_by_turns(windage, np.sort(np.append(angle, 2 * np.pi * 123.3)))
    return np.delete(run, 57 * per_turn) + 1e-5 * rng.normal(size=run.size - 1)


@pytest.mark.parametrize("windage", [WINDAGE, 0.0])
@pytest.mark.parametrize("per_turn", [1, 24])
def test_pulses_of_a_run_down_show_its_drag(windage: float, per_turn: int, tmp_path: Path) -> None:
    path = tmp_path / "pulses.csv"
    rows = "".join(f"{time:.9f}\n" for time in pulse_times(windage, per_turn))
    path.write_text(f"pulse_time_s\n{rows}", encoding="utf-8")
    table = read_table(path, per_turn)
    assert f"{per_turn} a turn, 1 missed, 1 phantom" in table.notes[0]
    wheel = bench(INERTIA).model_copy(update={"pulses_per_turn": per_turn})
    made = as_measured([("pulses", table.samples)], wheel)
    assert "time steps are uneven" in made.notes[0]
    search = find_discrepancy([("pulses", table.samples)], wheel)
    assert names(search) == (["quadratic_drag"] if windage else [])
    assert search.result.unexplained is None
    untested = dict(search.result.untested)
    assert untested["torque_ripple"] == MEAN_OF_A_TURN
    assert "coloured_noise" in untested
    assert search.extended.fit.coefficients[0] == pytest.approx(0.002, rel=0.02)
    if windage:
        assert search.result.effects[0].parameters["strength_Nm_s2_rad2"].value == pytest.approx(WINDAGE, rel=0.01)


@pytest.mark.parametrize("uneven", [pytest.param(0.0, marks=pytest.mark.slow), 0.3])
def test_runs_down_in_one_table_apart_in_time_are_recordings_of_their_own(uneven: float) -> None:
    runs = [run_down(WINDAGE, uneven, seed=seed) for seed in range(3)]
    runs.append(runs[0][:5])
    apart = 1_800_000_000_000 * np.arange(4)
    table = concatenate([replace(run, time_ns=run.time_ns + by) for run, by in zip(runs, apart.tolist(), strict=True)])
    made = as_measured([("runs", table)], bench(), [("aside", runs[0])])
    assert [name for name, _ in made.recordings] == ["runs (1 of 3)", "runs (2 of 3)", "runs (3 of 3)"]
    assert [name for name, _ in made.held_out] == ["aside"]
    assert "runs: 3 breaks, the longest of" in made.notes[0]
    assert "read as 3 recordings; 5 rows in stretches of fewer than 16 left out" in made.notes[0]
    search = find_discrepancy([("runs", table)], bench())
    assert names(search) == ["quadratic_drag"]
    strength = search.result.effects[0].parameters["strength_Nm_s2_rad2"]
    assert strength.value == pytest.approx(WINDAGE, rel=0.002)


def test_what_is_made_even_stays_as_it_is() -> None:
    time, speed = turns(WINDAGE)
    once = as_measured([("turns", samples(time, speed))], bench(INERTIA))
    again = as_measured(once.recordings, once.wheel)
    assert again.wheel == once.wheel
    for name, values in once.recordings[0][1].channels():
        np.testing.assert_array_equal(getattr(again.recordings[0][1], name), values)
    np.testing.assert_array_equal(once.recordings[0][1].speed_rad_s, speed)


def friction_at(time: Array, speed: Array, seed: int) -> Samples:
    """Return a table of a wheel whose friction is measured beside its speed."""
    noise = 5e-4 * np.random.default_rng(seed).normal(size=time.size)
    return samples(time, speed, drag(speed, WINDAGE) + noise)


def measured(period_s: float) -> Wheel:
    return Wheel(name="bench", sample_period_s=period_s, inertia_kg_m2=INERTIA)


def test_recordings_of_other_steps_are_searched_together() -> None:
    dwells = friction_at(np.arange(400.0), np.repeat(np.linspace(2.0, 20.0, 20), 20), 1)
    begins = 20.0 * np.repeat(np.arange(8.0), 80)  # eight spins in one table, with most of the time between them
    within = np.tile(np.arange(80) / 100.0, 8)
    spins = friction_at(begins + within, 2.0 + 20.0 * within, 2)
    for one, step_s in ((dwells, 1.0), (spins, 0.01)):
        assert as_measured([("log", one)], measured(0.1)).wheel.sample_period_s == pytest.approx(step_s)
    search = find_discrepancy([("dwells", dwells), ("spins", spins)], measured(1.0))
    assert names(search) == ["quadratic_drag"]
    assert search.problem.size == len(dwells) + len(spins)
    assert search.result.effects[0].parameters["strength_Nm_s2_rad2"].value == pytest.approx(WINDAGE, rel=0.02)
