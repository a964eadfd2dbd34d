"""Records: friction given or derived, gaps, rest, wrong units."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from rwa_monitor.discrepancy.extended import extended_wheel
from rwa_monitor.discrepancy.plausible import NEIGHBOURS, at_end_stop, least_reported
from rwa_monitor.discrepancy.quantisation import without_steps
from rwa_monitor.discrepancy.record import left_out_in_words, make_record
from rwa_monitor.errors import InputError
from rwa_monitor.reporting.discrepancy_report import steps_in_words
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.torque_balance import inertia_of
from rwa_monitor.wheel.wheel import Limits, Wheel
from tests.discrepancy.simple import (
    DRY_NM,
    NOISE_NM,
    PERIOD_S,
    VISCOUS,
    WHEEL,
    Array,
    current_of,
    names,
    record,
    sampled,
    search,
    swing,
)

PLAIN, _ = record(swing())
IN_RPM = replace(PLAIN, speed_rad_s=PLAIN.speed_rad_s * 60 / (2 * np.pi))


def with_current(speed: np.ndarray, friction: np.ndarray) -> Samples:
    return sampled(speed, motor_current_A=current_of(friction, speed))


def test_friction_is_derived_from_current_and_speed() -> None:
    speed = swing()
    friction = np.sign(speed) * 1.6e-3 + 5e-6 * speed
    made = make_record(with_current(speed, friction), WHEEL, "derived")
    assert made.friction_is_derived
    inner = made.used & (np.abs(speed) > 10)
    # The parabola through 17 samples of this swing errs by its third derivative: J·ω'''·(8 Δt)²/10 < 2e-6 N m.
    assert np.max(np.abs(made.friction_torque_Nm - friction)[inner]) < 2e-6
    assert not made.used[:8].any()  # the derivative has no value at the ends


def test_gaps_and_values_that_are_not_finite_are_left_out_and_keep_their_slots() -> None:
    samples, _ = record(swing())
    samples.friction_torque_Nm[100:110] = np.nan
    made = make_record(samples[np.r_[:2000, 2100 : len(samples)]], WHEEL, "gap")
    assert made.used.size == len(samples)
    assert not made.used[np.r_[100:110, 2000:2100]].any()
    assert made.used[[99, 110, 1999, 2100]].all()


def test_rest_is_left_out_but_crossings_stay() -> None:
    speed = swing()
    speed[3000:3400] = 0.0
    made = make_record(record(speed)[0], WHEEL, "rest")
    assert not made.used[3010:3390].any()
    assert made.left_out["at rest"] >= 380
    crossing = int(np.flatnonzero(np.diff(np.sign(swing())))[0])
    near = made.used[crossing - 40 : crossing + 40]
    # 250 rad/s in 600 s crosses zero at 2.6 rad/s²: five speed noises (0.05 rad/s) are passed within one slot.
    assert np.count_nonzero(~near) <= 2


@pytest.mark.parametrize(
    ("poor", "words"),
    [
        (replace(PLAIN, friction_torque_Nm=None), r"^poor: friction_torque_Nm is missing.*motor_off$"),
        (IN_RPM, "wrong unit"),
        (replace(PLAIN, time_ns=PLAIN.time_ns + 100 * PLAIN.time_ns[-1] * (PLAIN.time_ns > 0)), "recording is missing"),
    ],
)
def test_a_table_without_friction_in_other_units_or_far_too_sparse_is_refused(poor: Samples, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make_record(poor, WHEEL, "poor")


def test_without_limits_no_unit_is_wrong() -> None:
    make_record(IN_RPM, WHEEL.model_copy(update={"limits": Limits()}), "rpm")


@pytest.mark.parametrize(("factor", "refused"), [(1.0, False), (1000.0, True), (0.001, True)])
def test_a_voltage_that_contradicts_the_speed_is_refused(factor: float, refused: bool) -> None:
    speed = swing()
    samples = with_current(speed, np.sign(speed) * 1.6e-3)
    voltage = WHEEL.winding_resistance_ohm * samples.motor_current_A + WHEEL.back_emf_constant_V_s_rad * speed
    samples = replace(samples, motor_voltage_V=factor * voltage)
    with pytest.raises(InputError, match="contradicts") if refused else nullcontext():
        make_record(samples, WHEEL, "volts")


def test_every_sample_that_is_left_out_has_a_reason() -> None:
    # Slews by steps of torque: at their beginning and end the speed has corners.
    rng = np.random.default_rng(50070)
    speed = 100.0 + np.cumsum(np.repeat([0.0, 4.0, 0.0, -4.0, 0.0], 800) * PERIOD_S / 4.0)
    samples = with_current(speed, 1.6e-3 + 5.3e-6 * speed + NOISE_NM * rng.normal(size=speed.size))
    current = samples.motor_current_A.copy()
    stop = np.quantile(current, 0.98)
    current[current >= stop] = stop
    current[300:305] = np.nan
    made = make_record(replace(samples, motor_current_A=current), WHEEL, "corners")
    assert sum(made.left_out.values()) + np.count_nonzero(made.used) == len(samples)
    why = {words.split()[0]: count for words, count in made.left_out.items()}
    assert why.keys() == {"without", "at", "beside"}
    assert made.left_out["without a value of speed or torque"] == 5
    at_end = np.flatnonzero(current == stop)
    near = np.abs(np.arange(len(samples))[:, np.newaxis] - at_end) <= NEIGHBOURS // 2
    assert made.left_out["at the end stop or in the dead zone of a channel"] == np.count_nonzero(
        (current == stop) | (near.sum(axis=1) > 1)
    )
    assert made.left_out["at corners of the speed, where dω/dt is not known"] >= 4
    words = left_out_in_words([made, made])
    assert words.startswith("left out: 10 without a value of speed or torque, ")
    assert "at corners of the speed" in words
    assert left_out_in_words([make_record(record(swing())[0], WHEEL, "given")]) in ("", "left out: 1 at rest")


@pytest.mark.parametrize(("kind", "least_A"), [("crossings", 0.05), ("orbit", 0.1), ("rich", 0.15)])
def test_a_current_that_is_too_small_to_be_reported_is_unknown(kind: str, least_A: float) -> None:
    profile = SpeedProfile.model_validate({"kind": kind})
    scenario = Scenario(speed=profile, duration_s=1500.0, friction_given=False, channels=("motor_current_A",))
    limits = WHEEL.limits.model_copy(update={"min_current_A": least_A})
    samples = simulate(scenario, WHEEL.model_copy(update={"limits": limits}), np.random.default_rng(5)).samples
    unknown = np.count_nonzero((samples.motor_current_A == 0.0) & (samples.speed_rad_s != 0.0))
    found = search(samples)
    assert names(found) == []
    (made,) = found.problem.records
    assert made.left_out["at the end stop or in the dead zone of a channel"] == unknown > 500
    assert extended_wheel(found).limits.min_current_A == pytest.approx(least_A, rel=0.01)


@pytest.mark.parametrize("load", [0.0, 0.2])
def test_the_zero_current_of_a_motor_that_is_off_is_a_measurement(load: float) -> None:
    """A wheel is driven and coasts in turn, its friction jumps, and is larger by a share of the motor's torque."""
    rng, torque, speed = np.random.default_rng(0), np.zeros(8000), np.full(8000, 50.0)
    level = DRY_NM * rng.choice([1.0, 1.5, 2.0], 16).repeat(500)
    for k in range(1, speed.size):
        driven = speed[k - 1] < 60.0 or (torque[k - 2] > 0.0 and speed[k - 1] < 200.0)
        torque[k - 1] = 0.02 * (1.0 + 0.02 * rng.normal()) * driven
        friction = level[k] + VISCOUS * speed[k - 1] + load * torque[k - 1]
        speed[k] = speed[k - 1] + PERIOD_S * (torque[k - 1] - friction) / inertia_of(WHEEL)
    assert 0.2 < np.mean(torque == 0.0) < 0.8
    assert least_reported(torque, speed + 0.01 * rng.normal(size=speed.size), WHEEL) is None


def test_a_stated_dead_zone_of_the_current_leaves_a_motor_that_is_off_its_zeros() -> None:
    limits = WHEEL.limits.model_copy(update={"min_current_A": 0.05})
    off = WHEEL.model_copy(update={"limits": limits, "friction": WHEEL.friction.model_copy(update={"motor_off": True})})
    assert least_reported(np.zeros(100), np.full(100, 50.0), off) is None


def test_single_readings_of_zero_show_no_dead_zone() -> None:
    torque = DRY_NM + VISCOUS * PLAIN.speed_rad_s
    torque[::10] = 0.0
    assert least_reported(torque, PLAIN.speed_rad_s, WHEEL) is None


def test_motion_channels_share_no_noise_with_the_friction_of_their_slot() -> None:
    # With raw dω/dt a false inertia error of 1.6 % shows at |t| = 36. The correlation of pure
    # noise in friction and in the prepared acceleration must be that of independent samples.
    rng = np.random.default_rng(1)
    speed = 200.0 + rng.normal(0, 0.01, 20_000)
    made = make_record(with_current(speed, np.full(speed.size, 1.6e-3)), WHEEL, "noise")
    friction = (made.friction_torque_Nm - 1.6e-3)[made.used]
    correlation = np.corrcoef(friction, made.channels.acceleration_rad_s2[made.used])[0, 1]
    # Both series are smooth over some 20 slots, so that about 1000 values are independent: 4 σ is 0.13.
    assert abs(correlation) < 4 / np.sqrt(friction.size / 20)
    assert np.std(friction) > 0.1 * NOISE_NM


@pytest.mark.parametrize("error_kg_m2", [0.0, 5e-6])
def test_inertia_shows_in_strokes_of_a_few_samples(error_kg_m2: float) -> None:
    # 60 strokes to and fro in ten samples, rests left out: of dω/dt over the usual 17 slots nothing is left.
    rng, at = np.random.default_rng(0), np.arange(60 * 26)
    speed, slope = np.zeros(at.size), np.zeros(at.size)
    for number in range(60):
        phase, top = (at - 26 * number - rng.uniform(0.0, 10.0)) / 5.0, rng.uniform(50.0, 100.0)
        moving = (phase > 0.0) & (phase < 2.0)
        speed[moving] = top * np.sin(np.pi * phase[moving])
        slope[moving] = top * np.pi / (5.0 * PERIOD_S) * np.cos(np.pi * phase[moving])
    samples, _ = record(speed, (), lambda speed, level: error_kg_m2 * slope)
    assert names(search(samples[speed != 0.0]))[:1] == ["inertia_error"] * (error_kg_m2 > 0.0)


@pytest.mark.parametrize("noise_rad_s", [0.0, 0.02])
def test_an_inertia_error_in_trapezoidal_slews_is_no_set_of_jumps(noise_rad_s: float) -> None:
    # A dω/dt that is smoothed over the corners leaves a pulse of half the step at each: levels explained the slews.
    rng, at = np.random.default_rng(4), np.arange(6000)
    corners = np.cumsum(rng.integers(150, 350, 60))
    speed = np.interp(at, corners - corners[0], np.repeat(rng.uniform(-250.0, 250.0, 30), 2))
    slope = np.diff(speed, append=speed[-1]) / PERIOD_S
    samples, _ = record(speed, (), lambda speed, level: 0.02 * WHEEL.inertia_kg_m2 * slope)
    found = search(replace(samples, speed_rad_s=speed + noise_rad_s * rng.normal(size=at.size)))
    assert names(found) == ["inertia_error"]
    assert not found.result.unexplained
    strength = found.result.effects[0].parameters["strength_kg_m2"]
    assert strength.value == pytest.approx(0.02 * WHEEL.inertia_kg_m2, rel=0.01)
    assert found.extended.fit.jumps.size < 4


def test_the_slope_of_the_speed_is_exact_up_to_a_corner() -> None:
    slope = np.repeat(np.resize([1.0, 0.0, -1.0, 0.0], 40), 100)  # per slot
    samples, _ = record(100.0 + np.append(0.0, np.cumsum(slope[:-1])), ())
    made = make_record(samples, WHEEL, "slews")
    error = np.abs(made.channels.acceleration_rad_s2 * PERIOD_S - slope)
    # The noise of the speed is 0.01 rad/s; a slope from six slots has a fourth of it, five standard deviations here.
    assert np.max(error[made.used]) < 5 * 0.01 / 4.2
    assert 39 <= made.left_out["at corners of the speed, where dω/dt is not known"] <= 40


def test_corners_of_ramps_are_left_out_where_friction_itself_changes_within_the_filter() -> None:
    rng, at = np.random.default_rng(0), np.arange(4000) * 0.02
    speed = 2.0 * np.interp(at, np.linspace(0.0, 80.0, 7), np.resize([-1.0, 1.0], 7))
    drag = 5.0 * np.sign(speed) + 2.0 * speed
    torque = drag + 3.0 * np.gradient(speed, 0.02) + rng.normal(0.0, 0.05, at.size)
    ramps = sampled(speed + rng.normal(0.0, 1e-3, at.size), period_s=0.02, motor_torque_Nm=torque)
    wheel = Wheel(name="geared", sample_period_s=0.02, inertia_kg_m2=3.0)
    made = make_record(ramps, wheel, "ramps")
    near = np.abs(at[:, None] - np.arange(1, 6) * 80.0 / 6).min(axis=1) < 0.4
    assert not made.used[near].any()
    assert np.mean(made.used[~near]) > 0.8
    assert names(search(ramps, wheel)) == []


@pytest.mark.parametrize("rows", [30, 40, 64])
def test_a_corner_in_a_table_of_a_few_rows_is_no_error(rows: int) -> None:
    speed = 100.0 + np.interp(np.arange(rows), [0, rows // 2, rows], [0.0, 0.0, 50.0])
    noise = NOISE_NM * np.random.default_rng(rows).normal(size=rows)
    made = make_record(sampled(speed, DRY_NM + VISCOUS * speed + noise), WHEEL, "short")
    assert np.count_nonzero(made.used) == rows
    assert np.isfinite(made.channels.acceleration_rad_s2).all()


@pytest.mark.parametrize("backwards", [False, True])
def test_a_step_of_torque_in_the_first_or_last_sample_leaves_no_friction_beside_it(backwards: bool) -> None:
    wheel = WHEEL.model_copy(update={"sample_period_s": 1.0})
    rng = np.random.default_rng(0)
    accelerating = np.repeat([0.0, -4e-3, 0.0, 4e-3, 0.0], [1, 60, 60, 60, 60])[:: -1 if backwards else 1]
    speed = 300.0 + np.cumsum(np.convolve(accelerating, [0.5, 0.5], "same")) / inertia_of(wheel)
    friction = DRY_NM + 5e-6 * speed + NOISE_NM * rng.standard_normal(speed.size)
    current = (accelerating + friction) / wheel.torque_constant_Nm_A
    made = make_record(sampled(speed, period_s=1.0, motor_current_A=current), wheel, "derived")
    off = np.abs(made.friction_torque_Nm - friction)[made.used]
    assert made.used.sum() > 200
    assert off.max() < 10.0 * NOISE_NM


# ---- channels at their end stops -------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0.02, 0.5), one_sided=st.booleans())
def test_what_is_clipped_is_found_to_the_sample(seed: int, share: float, one_sided: bool) -> None:
    values = np.random.default_rng(seed).normal(size=2000)
    low, high = np.quantile(values, 0.0 if one_sided else share / 2), np.quantile(values, 1 - share / 2)
    stopped = at_end_stop(np.clip(values, low, high))
    expected = (values >= high) | ((values <= low) & (not one_sided))
    assert np.array_equal(stopped, expected)


@pytest.mark.parametrize(
    "values",
    [
        np.random.default_rng(1).normal(size=2000),
        np.tile([0.2, -0.2, 0.0, 0.2], 500),  # commanded
        np.round(np.random.default_rng(2).normal(size=2000), 1),  # a coarse converter
        np.full(2000, 3.0),
        np.full(2000, np.nan),
    ],
    ids=["noise", "commanded", "coarse", "constant", "unknown"],
)
def test_what_is_not_clipped_is_left(values: np.ndarray) -> None:
    assert not at_end_stop(values).any()


def test_friction_at_its_end_stop_now_and_then_makes_no_effect() -> None:
    """The end stop alone would pass for a drag that grows less than the speed."""
    samples, _ = record(swing(4000), jumps=())
    limit = float(np.quantile(np.abs(samples.friction_torque_Nm), 0.9))
    clipped = np.clip(samples.friction_torque_Nm, -limit, limit)
    result = search(replace(samples, friction_torque_Nm=clipped)).result
    assert [effect.name for effect in result.effects if effect.family == "mean"] == []
    assert limit > DRY_NM


# ---- torque that is read in coarse steps, or averaged over a reversal ------------------------------------------------


SEED = 52_200
STRIBECK_NM, STRIBECK_RAD_S = 5e-4, 8.0
FINE_STEPS = 8  # of the time within a sample


def motion(count: int = 8000) -> Array:
    """Return a swing with dwells in it, on which a rounding error rests [rad/s]."""
    speed = swing(count)
    for k in range(500, count - 700, 2000):
        speed[k : k + 600] = speed[k]
        speed[k + 600 : k + 700] = np.linspace(speed[k], speed[k + 700], 100)
    return speed


def read_in_steps(samples: Samples, step: float) -> Samples:
    """Return samples whose friction is rounded [N m]."""
    return replace(samples, friction_torque_Nm=step * np.rint(samples.friction_torque_Nm / step))


@pytest.mark.parametrize("step", [1.5, 2.0, 4.0])
def test_steps_of_friction_make_no_effect_and_no_other_noise(step: float) -> None:
    samples, _ = record(motion(), seed=SEED)
    found = search(read_in_steps(samples, step * NOISE_NM))
    assert found.result.verdict == "adequate"
    # The standard error of a standard deviation from 8000 samples is 0.8 %; coarse steps show less of it.
    assert found.problem.noise.std == pytest.approx(NOISE_NM, rel=0.05)
    assert f"friction is quantised in steps of {step * NOISE_NM * 1e6:.4g} µN m" in steps_in_words(found.problem)


def test_steps_of_the_current_are_reported_and_make_no_effect() -> None:
    speed = swing(6_000, period_s=900.0)
    samples, _ = record(speed, seed=SEED + 1)
    current = 2.4e-3 * np.rint(current_of(samples.friction_torque_Nm, speed) / 2.4e-3)
    found = search(replace(samples, friction_torque_Nm=None, motor_current_A=current))
    assert found.result.verdict == "adequate"
    assert "current is quantised in steps of 2.4 mA" in steps_in_words(found.problem)


def test_an_effect_is_found_behind_the_steps() -> None:
    speed = swing(top=60.0)
    stribeck = STRIBECK_NM * np.exp(-((speed / STRIBECK_RAD_S) ** 2)) * np.sign(speed)
    samples, _ = record(speed, effect=lambda *_: stribeck, seed=SEED + 2)
    (effect,) = search(read_in_steps(samples, 4.0 * NOISE_NM)).result.effects
    assert effect.name == "stribeck"
    strength = effect.parameters["strength_Nm"]
    assert abs(strength.value - STRIBECK_NM) < 4.0 * strength.std


def test_what_is_drawn_within_the_steps_is_the_law_of_the_noise() -> None:
    samples, level = record(motion(), jumps=(), seed=SEED + 3)
    read = make_record(read_in_steps(samples, 3.0 * NOISE_NM), WHEEL, "read")
    (drawn,) = without_steps([read], WHEEL)
    apart = np.abs(drawn.friction_torque_Nm - read.friction_torque_Nm)[read.used]
    assert apart.max() <= 1.5 * NOISE_NM * (1 + 1e-9)
    speed = samples.speed_rad_s
    noise = ((drawn.friction_torque_Nm - np.sign(speed) * level - VISCOUS * speed) / NOISE_NM)[read.used]
    # Level, slope and spread are fitted, which only brings the laws nearer.
    assert stats.kstest(noise, "norm").pvalue > 1e-3


def test_no_number_changes_where_steps_are_fine_or_none() -> None:
    samples, _ = record(motion(), seed=SEED + 4)
    for table in (samples, read_in_steps(samples, 0.05 * NOISE_NM)):
        before = make_record(table, WHEEL, "table")
        (after,) = without_steps([before], WHEEL)
        assert after.steps is None
        assert after.friction_torque_Nm is before.friction_torque_Nm


def averaged(seed: int, shift: float) -> tuple[Samples, Array]:
    """Return samples that are means over their slot, whose middle is `shift` slots off, and where they straddle."""
    speed = swing(8000, period_s=250.0)
    at = np.arange(speed.size)[:, None] + shift + (np.arange(FINE_STEPS) + 0.5) / FINE_STEPS - 0.5
    inside = np.interp(at, np.arange(speed.size), speed)
    samples, _ = record(speed, jumps=(), seed=seed)
    mean_sign = np.sign(inside).mean(axis=1)
    friction = samples.friction_torque_Nm + DRY_NM * (mean_sign - np.sign(speed))
    return replace(samples, friction_torque_Nm=friction), np.flatnonzero(np.abs(mean_sign) < 1)


@pytest.mark.parametrize(("shift", "noise_rad_s"), [(0.0, 0.0), (-0.5, 0.0), (0.0, 0.1)])
def test_means_over_a_reversal_make_no_effect(shift: float, noise_rad_s: float) -> None:
    samples, straddling = averaged(SEED + 5, shift)
    assert straddling.size >= 3
    noise = noise_rad_s * np.random.default_rng(SEED).standard_normal(len(samples))
    samples = replace(samples, speed_rad_s=samples.speed_rad_s + noise)
    found = search(samples)
    assert found.result.verdict == "adequate"
    (read,) = found.problem.records
    assert not read.used[straddling].any()
    assert read.left_out.get("averaged over a reversal of the speed", 0) <= 2 * straddling.size


def test_a_rest_does_not_hide_that_samples_are_means() -> None:
    samples, straddling = averaged(SEED + 5, 0.0)
    rng, at, count = np.random.default_rng(SEED + 6), int(straddling[1]), 100
    friction = np.insert(samples.friction_torque_Nm, at, DRY_NM * rng.uniform(-1.0, 1.0, count))
    speed = np.insert(samples.speed_rad_s, at, 0.02 * rng.standard_normal(count))
    time_ns = samples.time_ns[0] + np.arange(speed.size) * int(samples.time_ns[1] - samples.time_ns[0])
    read = make_record(replace(samples, time_ns=time_ns, speed_rad_s=speed, friction_torque_Nm=friction), WHEEL, "rest")
    elsewhere = straddling[np.abs(straddling - at) > 1]
    assert not read.used[elsewhere + count * (elsewhere > at)].any()


def test_the_end_of_a_dead_zone_is_stated_as_well_as_samples_lie_around_it() -> None:
    zone = 12.0
    samples, _ = record(swing(4000), (), lambda w, level: -level * np.sign(w) * (np.abs(w) < zone), seed=SEED + 7)
    found = {effect.name: effect for effect in search(samples).result.effects}
    end = found["speed_dead_zone"].parameters["dead_zone_rad_s"]
    assert end.std > 0.0
    speeds = np.sort(np.abs(samples.speed_rad_s))
    above = int(np.searchsorted(speeds, end.value))
    assert 4.0 * end.std >= speeds[above] - speeds[above - 1]  # two deviations to either side hold the gap
    assert abs(end.value - zone) < 3.0 * end.std + 0.05  # speed noise of 0.01 rad/s on each sample
