"""What repeats with the angle is found at any order, passes for nothing else, and shows where the angle drifts."""

import numpy as np
import pytest

from rwa_monitor.discrepancy.angle import angle_line, time_between, track_drift
from rwa_monitor.discrepancy.extended import extend
from rwa_monitor.discrepancy.plan import plan
from rwa_monitor.discrepancy.record import Record
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.motion import wheel_angle
from rwa_monitor.wheel.wheel import Wheel
from tests.discrepancy.simple import DRY_NM, NOISE_NM, PERIOD_S, VISCOUS, Array, names, sampled, search
from tests.discrepancy.smooth import problem_of
from tests.wheel.effects.records import channels_of

COUNT = 6000
WHEEL = Wheel(name="slow", sample_period_s=PERIOD_S)


def slow(rng: np.random.Generator) -> Array:
    """Return a wheel that turns slowly in both directions, at no speed that repeats [rad/s]."""
    time = np.arange(COUNT) * PERIOD_S
    return 10.0 * np.sin(2 * np.pi * time / 331.0 + rng.uniform(0, 6)) + 4.0 * np.sin(2 * np.pi * time / 97.0)


def record(speed: Array, order: float, rub_Nm: float, ripple_Nm: float, rng: np.random.Generator) -> Samples:
    """Return friction with a rub once in a period of the angle, and a ripple."""
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * PERIOD_S)])
    part = np.mod(order * angle / (2 * np.pi), 1.0)
    friction = np.sign(speed) * (DRY_NM + rub_Nm * np.exp(-0.5 * ((part - 0.5) / 0.08) ** 2)) + VISCOUS * speed
    friction += ripple_Nm * np.cos(2 * np.pi * part) + rng.normal(0.0, NOISE_NM, COUNT)
    return sampled(speed + rng.normal(0, 2e-4, COUNT), friction)


@pytest.mark.parametrize(("seed", "order"), [(53030, 0.393), (53031, 3.07)])
def test_a_rub_by_the_angle_is_reported_with_its_order_and_feeds_no_other_name(seed: int, order: float) -> None:
    rng = np.random.default_rng(seed)
    found = search(record(slow(rng), order, 4e-4, 0.0, rng), WHEEL)
    assert not found.result.effects
    words = found.result.unexplained.signature
    assert "periodic in the wheel's angle" in words
    assert abs(float(words.split("at order ")[1].split(" ±")[0]) - order) < 1e-3
    assert "no whole number" in words
    assert any("wheel's angle" in line for line in plan(found).advice)


@pytest.mark.parametrize(("seed", "order"), [pytest.param(53033, 0.393, marks=pytest.mark.slow), (53034, 30.67)])
def test_a_ripple_of_no_whole_order_is_named_with_its_order(seed: int, order: float) -> None:
    rng = np.random.default_rng(seed)
    samples = record(slow(rng), order, 0.0, 1e-4, rng)
    for unknown in (slice(57), slice(COUNT // 2, COUNT // 2 + 57)):
        samples.friction_torque_Nm[unknown] = np.nan  # the wheel turns, as where friction cannot be derived
    found = search(samples, WHEEL)
    (ripple,) = found.result.effects
    assert ripple.name == "torque_ripple"
    assert "torque_ripple" not in dict(found.result.untested)
    assert abs(ripple.parameters["harmonic"].value - order) < 1e-2
    extended = Wheel.from_toml(extend(found).to_toml(), "extended")
    assert extended.effect[0].parameters["harmonic"] == pytest.approx(order, abs=1e-2)
    simulated = found.result.gain.simulated
    assert simulated.rmse_extended_Nm < 1.05 * NOISE_NM < 0.7 * simulated.rmse_base_Nm


@pytest.mark.parametrize("seed", range(53035, 53041))
def test_noise_and_a_line_in_time_are_none_over_the_angle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    samples = record(slow(rng), 1.0, 0.0, 0.0, rng)
    hum = 2e-4 * np.cos(2 * np.pi * 0.31 * samples.time_ns * 1e-9) * (seed % 2)
    problem = problem_of(sampled(samples.speed_rad_s, samples.friction_torque_Nm + hum), wheel=WHEEL)
    assert angle_line(problem) is None


def test_in_one_direction_a_line_of_whole_order_is_left_to_the_ripple() -> None:
    rng = np.random.default_rng(53041)
    found = search(record(18.0 + slow(rng), 3.0, 0.0, 1e-4, rng), WHEEL)
    assert names(found) == ["torque_ripple"]
    assert found.result.unexplained is None


def to_and_fro(turns: float, rng: np.random.Generator) -> Array:
    """Return a wheel whose angle stays within so many turns [rad/s]."""
    time = np.arange(COUNT) * PERIOD_S
    speed = np.cos(2 * np.pi * time / 113.0 + rng.uniform(0, 6))
    speed += 0.5 * np.cos(2 * np.pi * time / 41.3 + rng.uniform(0, 6))
    return speed * turns * 2 * np.pi / np.ptp(np.cumsum(speed) * PERIOD_S)


@pytest.mark.parametrize(
    ("seed", "turns", "order", "ripple_Nm"),
    [
        pytest.param(50110, 1.5, 30.67, 1e-4, marks=pytest.mark.slow),
        (50111, 1.5, 31.0, 1e-4),
        (50112, 10.0, 12.43, 5e-5),
        pytest.param(50113, 0.5, 6.0, 2e-5, marks=pytest.mark.slow),
    ],
)
def test_a_few_turns_tell_an_order_as_well_as_they_can(seed: int, turns: float, order: float, ripple_Nm: float) -> None:
    rng = np.random.default_rng(seed)
    found = search(record(to_and_fro(turns, rng), order, 0.0, ripple_Nm, rng), WHEEL)
    (ripple,) = found.result.effects
    assert ripple.name == "torque_ripple"
    order_found = ripple.parameters["harmonic"]
    assert order_found.std < 0.1 / turns
    assert abs(order_found.value - order) < 4.0 * order_found.std
    assert (order_found.value == order) is order.is_integer()  # a whole order stays where nothing contradicts it
    assert found.result.gain.rmse_extended_Nm < 1.03 * NOISE_NM


def test_orders_that_look_alike_over_the_angles_travelled_are_reported_together() -> None:
    rng = np.random.default_rng(50114)
    speed = to_and_fro(0.06, rng)
    speed[COUNT // 2 : COUNT // 2 + 80] += 2 * np.pi / (80 * PERIOD_S)  # a turn further, and on as before
    found = search(record(speed, 20.0, 0.0, 1.5e-5, rng), WHEEL)
    (ripple,) = found.result.effects
    order_found = ripple.parameters["harmonic"]
    assert order_found.std is None
    assert "20" in order_found.note
    assert "fit about as well over 1.1 turns" in order_found.note


# ---- the phase of a ripple shows the drift of an integrated angle ----------------------------------------------------


SPEED_NOISE_RAD_S = 0.02
SIZE = 20_000
HARMONIC = 11
SWEPT_RAD_S = 200.0 + 80.0 * np.sin(2 * np.pi * np.arange(SIZE) / 9_000)


def record_of(speed: Array, noise_rad_s: float = SPEED_NOISE_RAD_S) -> Record:
    angle = wheel_angle(speed, PERIOD_S)
    channels = channels_of(speed, acceleration_rad_s2=np.gradient(speed, PERIOD_S), angle_rad=angle)
    return Record("r", channels, np.zeros(SIZE), np.ones(SIZE, dtype=bool), False, noise_rad_s)


def test_the_drift_that_speed_noise_makes_is_found_by_the_ripple() -> None:
    rng = np.random.default_rng(5)
    error = rng.normal(0, SPEED_NOISE_RAD_S, SIZE)
    angle, wandered = wheel_angle(SWEPT_RAD_S, PERIOD_S), wheel_angle(error, PERIOD_S)
    residual = np.sin(HARMONIC * angle) + rng.standard_normal(SIZE)
    drift = track_drift(record_of(SWEPT_RAD_S + error), residual, 1.0)
    # With the drift added to the integral of the measured speed, the phase stands still but for a constant.
    left = HARMONIC * (wandered + drift)
    assert np.std(HARMONIC * wandered) > 0.8  # rad: the ripple would be lost
    # A block is an eighth of the coherent length, over which the phase wanders by 1/√8 rad, and is known at its middle.
    assert np.std(left) < 1 / np.sqrt(8)


def test_no_drift_is_read_into_noise() -> None:
    rng = np.random.default_rng(6)
    speed = SWEPT_RAD_S + rng.normal(0, SPEED_NOISE_RAD_S, SIZE)
    assert track_drift(record_of(speed), rng.standard_normal(SIZE), 1.0) is None


@pytest.mark.parametrize("later_s", [-0.04, 0.0123, 0.1])
def test_friction_that_is_read_later_than_the_speed_turns_a_ripple_with_the_speed(later_s: float) -> None:
    rng = np.random.default_rng(7)
    angle = wheel_angle(SWEPT_RAD_S, PERIOD_S)
    residual = 0.3 * np.sin(HARMONIC * (angle + later_s * SWEPT_RAD_S)) + rng.standard_normal(SIZE)
    found = time_between(record_of(SWEPT_RAD_S, 1e-4), residual)
    # By as much as turns the harmonic by less than half a radian over the range of the speed.
    assert abs(found - later_s) < 0.5 / (HARMONIC * np.ptp(SWEPT_RAD_S))


@pytest.mark.parametrize("seed", range(20))
def test_neither_noise_nor_a_ripple_read_with_the_speed_is_later(seed: int) -> None:
    rng = np.random.default_rng(seed)
    noise, angle = rng.standard_normal(SIZE), wheel_angle(SWEPT_RAD_S, PERIOD_S)
    assert time_between(record_of(SWEPT_RAD_S, 1e-4), noise) == 0.0
    assert time_between(record_of(SWEPT_RAD_S, 1e-4), np.sin(HARMONIC * angle) + noise) == 0.0
