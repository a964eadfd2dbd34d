"""Running sums: any range's moments, exactly, from few reads."""

import math

import numpy as np
import pytest

from rwa_monitor.changepoints.running_sums import RunningSums, Structure, StructureSums, stretch_hop
from rwa_monitor.kernels.running_sums import BLOCK, STRETCH, STRIDE, count_signs, extend_structure, extend_sums
from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.wheel.effects.torque_ripple import MAX_HARMONIC
from tests.switching.assignment_windows import record_of


def _sums(x, z, used, step=BLOCK):
    sums = RunningSums(x, z, used)
    for stop in (*range(step, x.size, step), x.size):
        extend_sums(sums.arrays, sums.running, sums.slots, stop)
        sums.slots = stop
    return sums


def _record(seed, n, offset=0.0, share=0.9):
    x, z, used = record_of(seed, n, share=share)
    return x, z + offset, used


@pytest.mark.parametrize("offset", [0.0, 1e3, -1e6])
def test_moments_of_random_ranges_equal_exact_sums(offset):
    x, z, used = _record(1, 5000, offset)
    sums = _sums(x, z, used)
    start, stop = np.sort(np.random.default_rng(1).integers(0, 5001, (2, 200)), axis=0)
    moments = sums.between(start, stop)
    for i in range(200):
        here = np.arange(start[i], stop[i])[used[start[i] : stop[i]]]
        u, v = x[here], z[here]
        exact = [math.fsum(terms) for terms in (np.ones(u.size), u, v, u * u, u * v, v * v)]  # correctly rounded
        assert moments[:, i] == pytest.approx(exact, rel=1e-12, abs=1e-9)


def test_variance_of_a_short_range_survives_a_large_offset():
    """The spread of 100 samples after 80,000 others, with an offset of 40,000 standard deviations."""
    x, z, used = _record(2, 80_000, offset=1e3, share=1.0)
    [n], _, [sum_z], _, _, [zz] = _sums(x, z, used).between(np.array([79_900]), np.array([80_000]))
    assert zz - sum_z**2 / n == pytest.approx(100 * np.var(z[79_900:]), rel=1e-6)


def test_a_wild_first_sample_does_not_become_the_centre():
    x, z, used = _record(3, 1000, share=1.0)
    z[0] = 1e4  # 400,000 standard deviations; beyond this a value is not taken as friction
    sums = _sums(x, z, used)
    [n], _, [sum_z], _, _, [zz] = sums.between(np.array([500]), np.array([900]))
    assert zz - sum_z**2 / n == pytest.approx(400 * np.var(z[500:900]), rel=1e-6)


def test_range_reads_at_most_one_stride_at_each_end():
    sums = _sums(*_record(4, 5000))
    here, there = np.array([3]), np.array([4999])
    whole = sums.between(here, there)
    sums.arrays.x[STRIDE - 1 : 5000 - STRIDE + 1] = sums.arrays.z[STRIDE - 1 : 5000 - STRIDE + 1] = np.nan
    np.testing.assert_array_equal(sums.between(here, there), whole)


def test_empty_and_reversed_ranges_are_zero_and_shapes_are_kept():
    sums = _sums(*_record(5, 100))
    found = sums.between(np.array([[5, 9], [50, 0]]), np.array([[5, 3], [60, 100]]))
    assert found.shape == (6, 2, 2)
    assert not found[:, 0].any()
    assert sums.between(np.array(3), np.array(7)).shape == (6,)
    assert sums.between(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)).shape == (6, 0)


@pytest.mark.parametrize(("start", "stop"), [(-1, 5), (0, 101), (101, 101)])
def test_a_range_beyond_the_window_is_refused(start, stop):
    sums = _sums(*_record(6, 100))
    with pytest.raises(IndexError, match="100 slots"):
        sums.between(np.array([start]), np.array([stop]))


# ---- what a window keeps beside its running sums ---------------------------------------------------------------------


SLOTS = 20_000
PERIOD_S = 0.125
BAND, CERTAIN = 1.0, 0.05  # rad/s


def gather(
    speed: FloatArray,
    z: FloatArray,
    good: BoolArray,
    band: float = BAND,
    certain: float = CERTAIN,
    angle_per_x: float = PERIOD_S,  # x in rad/s: the angle of a slot at x = 1
) -> Structure:
    """Gather a window."""
    x, hop = np.abs(speed), stretch_hop(speed.size)
    sums = StructureSums.of(speed.size)
    count_signs(0, speed, good, sums.signs, sums.counts)
    extend_structure(x, x, z, good, good & (x >= band), 0, speed.size, certain, angle_per_x, hop, sums)
    return sums.close()


def test_direction_and_dead_band_are_what_a_plain_sum_gives() -> None:
    rng = np.random.default_rng(2)
    speed = 60.0 * np.sin(2 * np.pi * np.arange(SLOTS) / 9_000.0) + 0.005 * rng.standard_normal(SLOTS)
    z, good = 1.0 + 0.02 * rng.standard_normal(SLOTS), rng.random(SLOTS) > 0.0005
    found = gather(speed, z, good)
    blocks = np.arange(SLOTS) // BLOCK
    near = good & (np.abs(speed) < BAND) & (np.abs(speed) > CERTAIN)
    assert near.any()
    for row, values in zip(found.near_zero, (np.ones(SLOTS), np.abs(speed), z, z**2), strict=True):
        np.testing.assert_allclose(row, np.bincount(blocks, np.where(near, values, 0.0)), rtol=1e-12)
    signs = np.bincount(blocks, good * np.sign(speed)) / np.bincount(blocks, good)
    np.testing.assert_allclose(found.direction, signs, rtol=1e-12)


def test_at_one_speed_jumps_do_not_look_like_a_ripple() -> None:
    rng = np.random.default_rng(50120)
    level = np.repeat(rng.uniform(0.0, 20.0, 50), SLOTS // 50)
    good = np.ones(SLOTS, dtype=np.bool_)
    for harmonic in (46, 56, 60, 95):
        turns = rng.uniform(-0.01, 0.01)  # of this harmonic in a slot, beside whole ones
        speed = np.full(SLOTS, (12 + turns) * 2.0 * np.pi / (harmonic * PERIOD_S))
        ripple = gather(speed, level + rng.standard_normal(SLOTS), good).ripple
        assert np.isnan(ripple[:, harmonic - 1]).all()
        assert np.nansum(ripple, axis=0).max() / len(ripple) < 10.0  # 26 to 43 without the limit


def test_a_dead_zone_is_distinguished_from_rest_and_from_a_lattice() -> None:
    rng = np.random.default_rng(4)
    good = np.ones(SLOTS, dtype=np.bool_)
    slow = 5.0 * np.sin(2 * np.pi * np.arange(SLOTS) / 9_000.0)

    def count(speed: FloatArray) -> tuple[int, int]:
        found = gather(speed, np.ones(SLOTS), good)
        return found.zero_runs, found.plateaus

    noisy = slow + 0.005 * rng.standard_normal(SLOTS)
    assert count(noisy) == (0, 0)
    dead = np.where(np.abs(noisy) < 0.5 * BAND, 0.0, noisy)
    assert count(np.where(np.abs(slow) < 0.05, 0.0, dead) / 10.0) == (5, 5)  # x below a tenth of the nominal speed
    fine = 0.005 * np.rint((0.1 * slow + 0.005 * rng.standard_normal(SLOTS)) / 0.005)  # reads zero by chance, too
    coarse = 0.02 * np.rint(slow / 0.02)
    rest = np.maximum(slow - 2.0, 0.0)  # stands still, then leaves in small steps
    for speed in (fine, coarse, rest):
        runs, plateaus = count(speed)
        assert runs > 0
        assert plateaus == 0


def test_the_ripple_is_the_power_at_multiples_of_the_angle() -> None:
    rng = np.random.default_rng(9)
    x, z = 1.0 + 0.01 * rng.standard_normal(STRETCH), rng.standard_normal(STRETCH)
    [power] = gather(x, z, np.ones(STRETCH, dtype=np.bool_), 0.0, 0.0, 0.61).ripple
    slots = np.arange(STRETCH)
    e = z - np.polyval(np.polyfit(slots, z, 1), slots)
    angle = 0.61 * np.concatenate(([0.0], np.cumsum(0.5 * (x[1:] + x[:-1]))))
    wave = np.exp(1j * np.outer(np.arange(1, 2 * MAX_HARMONIC + 1), angle))
    there = np.isfinite(power)
    assert there.sum() > MAX_HARMONIC
    np.testing.assert_allclose(power[there], (2.0 * np.abs(wave @ e) ** 2 / (e @ e))[there], rtol=1e-9)
