"""A current that is read later or earlier than the speed, in samples that are means of what happens between them."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.ndimage import shift, uniform_filter1d

from rwa_monitor.discrepancy.alignment import Delay, aligned, find_delay
from rwa_monitor.discrepancy.derived_friction import Motion
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.torque_balance import inertia_of, with_window
from tests.discrepancy.simple import PERIOD_S, WHEEL

FINE = 40  # steps a sample
COUNT = 2000
INERTIA = 1e-3
DRY_NM, VISCOUS, NOISE_NM = 2e-3, 4e-6, 2e-5


def motion(late_slots: float, seed: int, ripple_Nm: float = 0.0, slews: int = 20, noise_Nm: float = NOISE_NM) -> Motion:
    """Return a wheel that is accelerated in steps at any moment, never through rest; friction is the balance's."""
    rng = np.random.default_rng(seed)
    accelerating = np.zeros(COUNT * FINE)
    for begin in rng.uniform(0.02, 0.9, slews) * accelerating.size:
        at, length = int(begin), int(rng.uniform(20, 60) * FINE)
        accelerating[at : at + length] += rng.uniform(-4e-3, 4e-3)
    speed = 300.0 + np.cumsum(accelerating) / INERTIA * PERIOD_S / FINE
    angle = np.cumsum(speed) * PERIOD_S / FINE
    friction = (DRY_NM + ripple_Nm * np.cos(angle)) * np.sign(speed) + VISCOUS * speed

    torque = shift(accelerating + friction, late_slots * FINE, order=1, mode="nearest")
    read = sampled(torque) + noise_Nm * rng.standard_normal(COUNT)
    return Motion(sampled(speed), read, read - sampled(accelerating))


def sampled(values: FloatArray) -> FloatArray:
    """Return the mean of each slot."""
    return np.asarray(uniform_filter1d(values, FINE, mode="nearest")[FINE // 2 :: FINE])


def found(*motions: Motion, width_slots: int | None = None) -> Delay | None:
    """Return the delay that motions show; friction is derived over a width, or else given."""
    if width_slots is None:
        return find_delay(motions, WHEEL)
    wheel = with_window(WHEEL.model_copy(update={"inertia_kg_m2": INERTIA}), width_slots * PERIOD_S)
    return find_delay([replace(one, friction_Nm=None) for one in motions], wheel)


@pytest.mark.parametrize(
    ("width_slots", "late_slots"), [(None, -0.7), *product((None, 2, 6), (0.3, 0.65, -0.4, 1.7, 3.4))]
)
def test_impulses_around_steps_show_a_delay_of_any_part_of_a_slot(width_slots: int | None, late_slots: float) -> None:
    for seed in range(3):
        delay = found(motion(late_slots, seed), width_slots=width_slots)
        assert delay.late_slots == pytest.approx(late_slots, abs=max(4.0 * delay.std_slots, 0.02 * abs(late_slots)))
        assert width_slots or delay.slots + delay.part == delay.late_slots  # derived, -0.4 may be a torque that is held


@pytest.mark.parametrize("width_slots", [2, 6])
@pytest.mark.parametrize("seed", range(3))
def test_a_torque_that_is_held_from_sample_to_sample_is_not_late(width_slots: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    accelerating = 4e-3 * np.repeat(rng.uniform(-1.0, 1.0, COUNT // 50), 50)
    speed = 300.0 + np.append(0.0, np.cumsum(accelerating)[:-1]) / INERTIA * PERIOD_S
    torque = accelerating + DRY_NM + VISCOUS * speed + NOISE_NM * rng.standard_normal(COUNT)
    delay = found(Motion(speed, torque, None), width_slots=width_slots)
    assert delay.slots + delay.part == pytest.approx(-0.5, abs=0.05)
    assert delay.late_slots == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_two_slews_show_a_delay_where_their_impulses_are_far_above_the_noise(seed: int) -> None:
    delay = found(motion(1.3, seed, slews=2, noise_Nm=3e-5))
    assert delay.late_slots == pytest.approx(1.3, abs=4.0 * delay.std_slots)


def test_friction_is_unknown_where_the_direction_changes_within_a_part_of_a_slot() -> None:
    speed = np.linspace(-10.0, 10.0, 40)
    friction = DRY_NM * np.sign(speed)
    moved = aligned(Motion(speed, friction.copy(), friction), WHEEL, 1, 0.4)
    known = np.isfinite(moved.friction_Nm)
    assert not known[19:21].any()
    assert known[7:18].all()
    np.testing.assert_allclose(moved.friction_Nm[7:18], -DRY_NM)


@pytest.mark.parametrize("seed", range(20))
def test_where_nothing_is_late_no_delay_is_found_even_with_a_ripple_that_samples_alias(seed: int) -> None:
    assert found(motion(0.0, seed)) is None
    assert seed >= 5 or found(motion(0.0, seed, ripple_Nm=2e-3)) is None


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("slots_before", [5, 8, 14])
@pytest.mark.parametrize("seed", range(2))
def test_a_direction_that_changes_shortly_before_each_slew_ends_is_no_delay(
    given: bool, slots_before: int, seed: int
) -> None:
    inertia, slots = inertia_of(WHEEL), np.arange(400 * FINE) / FINE

    def slew(rng: np.random.Generator) -> Motion:
        accelerating = DRY_NM * np.interp(slots, [100, 106, 160, 166], [0.0, 1.0, 1.0, 0.0])
        speed = np.cumsum(accelerating) / inertia * PERIOD_S / FINE
        speed -= np.interp(160 - slots_before, slots, speed)  # friction steps there, twice as far as the slew's torque
        of_slots, inertial, dry = (sampled(values) for values in (speed, accelerating, DRY_NM * np.sign(speed)))
        friction = dry + NOISE_NM * rng.standard_normal(dry.size)
        return Motion(of_slots, inertial + friction, friction if given else None)

    assert found(*(slew(np.random.default_rng([seed, n])) for n in range(5))) is None


@pytest.mark.parametrize(("turn_slots", "build_up_slots"), [(300, 10), (300, 20), (600, 20)])
def test_friction_that_builds_up_over_an_angle_is_no_delay(turn_slots: int, build_up_slots: int) -> None:
    rng, phase = np.random.default_rng(turn_slots), np.arange(COUNT * FINE) / FINE * 2.0 * np.pi / turn_slots
    speed, angle = 3.0 * np.sin(phase), -3.0 * np.cos(phase) * turn_slots / (2.0 * np.pi)
    length = 0.5 * (3.0 * 2.0 * np.pi / turn_slots) * build_up_slots**2  # the angle turned in that time
    bent, friction = 0.0, np.empty(angle.size)
    for k, step in enumerate(np.diff(angle, prepend=angle[0]).tolist()):
        bent += (step - abs(step) * bent) / length  # Dahl
        friction[k] = DRY_NM * bent
    torque = friction + VISCOUS * speed + inertia_of(WHEEL) * np.gradient(speed, PERIOD_S / FINE)
    read = sampled(speed) + 1e-4 * rng.standard_normal(COUNT)
    assert found(Motion(read, sampled(torque) + NOISE_NM * rng.standard_normal(COUNT), None)) is None


def test_recordings_of_one_wheel_show_one_delay() -> None:
    one = found(motion(0.5, 0))
    both = found(motion(0.5, 0), motion(0.5, 1))
    assert both.std_slots < one.std_slots


def of_swing(late_slots: float, seed: int, sines: int = 2, breakaway_rad: float = 0.0) -> Delay | None:
    """Return the delay that a wheel shows which swings through zero without steps of its torque; friction is derived.

    Its dry friction builds up over the angle from a reversal (P. R. Dahl, 1968).
    """
    time_s = np.arange(COUNT * FINE) * PERIOD_S / FINE
    waves = [(250.0, 0.05), (120.0, 0.13)][:sines]
    speed = np.sum([size * np.sin(rate * time_s) for size, rate in waves], axis=0)
    slope = np.sum([size * rate * np.cos(rate * time_s) for size, rate in waves], axis=0)
    dry, bent = np.sign(speed), -1.0
    if breakaway_rad:
        for i, (sign, step) in enumerate(zip(dry.tolist(), (speed * PERIOD_S / FINE).tolist(), strict=True)):
            bent = float(np.clip(bent + (1.0 - sign * bent) * step / breakaway_rad, -1.0, 1.0))
            dry[i] = bent
    torque = shift(INERTIA * slope + DRY_NM * dry + VISCOUS * speed, late_slots * FINE, order=1, mode="nearest")
    noise = np.random.default_rng(seed).standard_normal(COUNT)
    return found(Motion(sampled(speed), sampled(torque) + NOISE_NM * noise, None), width_slots=2)


@pytest.mark.parametrize("late_slots", [1.0, -2.0, 3.4, 5.0])
def test_a_motion_without_steps_shows_a_delay_of_whole_slots(late_slots: float) -> None:
    for seed in range(3):
        delay = of_swing(late_slots, seed)
        assert delay.late_slots == delay.slots == round(late_slots)


@pytest.mark.parametrize("breakaway_rad", [0.0, 3.0, 30.0])
def test_a_motion_without_steps_and_delay_shows_none(breakaway_rad: float) -> None:
    for seed in range(3):
        assert of_swing(0.0, seed, breakaway_rad=breakaway_rad) is None


def test_in_a_single_sine_a_delay_is_viscous_friction() -> None:
    assert of_swing(3.0, 0, sines=1) is None
