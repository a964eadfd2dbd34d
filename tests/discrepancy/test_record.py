"""Records: friction given or derived, gaps, rest, wrong units."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.discrepancy.plausible import NEIGHBOURS
from rwa_monitor.discrepancy.record import left_out_in_words, make_record
from rwa_monitor.errors import InputError
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.torque_balance import inertia_of
from rwa_monitor.wheel.wheel import Limits
from tests.discrepancy.simple import DRY_NM, NOISE_NM, PERIOD_S, WHEEL, current_of, record, sampled, swing


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


def test_without_friction_and_current_a_record_is_refused() -> None:
    samples, _ = record(swing())
    with pytest.raises(InputError, match=r"^poor: friction_torque_Nm is missing.*motor_off$"):
        make_record(replace(samples, friction_torque_Nm=None), WHEEL, "poor")


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


def test_values_beyond_the_limits_are_a_wrong_unit() -> None:
    samples, _ = record(swing())
    in_rpm = replace(samples, speed_rad_s=samples.speed_rad_s * 60 / (2 * np.pi))
    with pytest.raises(InputError, match="wrong unit"):
        make_record(in_rpm, WHEEL, "rpm")
    make_record(in_rpm, WHEEL.model_copy(update={"limits": Limits()}), "rpm")


@pytest.mark.parametrize(("factor", "refused"), [(1.0, False), (1000.0, True), (0.001, True)])
def test_a_voltage_that_contradicts_the_speed_is_refused(factor: float, refused: bool) -> None:
    speed = swing()
    samples = with_current(speed, np.sign(speed) * 1.6e-3)
    voltage = WHEEL.winding_resistance_ohm * samples.motor_current_A + WHEEL.back_emf_constant_V_s_rad * speed
    samples = replace(samples, motor_voltage_V=factor * voltage)
    with pytest.raises(InputError, match="contradicts") if refused else nullcontext():
        make_record(samples, WHEEL, "volts")


def test_a_file_far_sparser_than_its_sample_period_is_refused() -> None:
    samples, _ = record(swing())
    with pytest.raises(InputError, match="sample_period_s"):
        make_record(replace(samples, time_ns=samples.time_ns * 50), WHEEL, "sparse")


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
    assert made.left_out["at the end stop of a channel, or among such"] == np.count_nonzero(
        (current == stop) | (near.sum(axis=1) > 1)
    )
    assert made.left_out["at corners of the speed, where derived friction is not known"] >= 4
    words = left_out_in_words([made, made])
    assert words.startswith("left out: 10 without a value of speed or torque, ")
    assert "at corners of the speed" in words
    assert left_out_in_words([make_record(record(swing())[0], WHEEL, "given")]) in ("", "left out: 1 at rest")


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
