"""The evidence of a window, gathered live: what it finds, and that it does not matter how the samples came."""

import os
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from rwa_monitor.changepoints.estimation import estimate
from rwa_monitor.changepoints.evidence import WindowAccumulator
from rwa_monitor.changepoints.stage_results import Candidates
from rwa_monitor.kernels.running_sums import BLOCK
from rwa_monitor.kernels.wglr import CHUNK, MOST_PEAKS
from rwa_monitor.wheel.durations import Geometric
from rwa_monitor.wheel.wheel import SwitchingSystem, Wheel, built_in_wheel

MEASURED = os.environ.get("RWA_MEASURED_DATA")
WHEEL = built_in_wheel()
TORQUE = 1.6e-3  # N m, the nominal dry torque
SIGMA = 3.9e-5  # N m, 0.024 of it


def _telemetry(seed, n, jumps=(), noise=None, crossing=False):
    """Return speed, friction and goodness: jumps are (slot, size in σ)."""
    rng = np.random.default_rng(seed)
    speed = 200.0 + 60.0 * np.sin(np.arange(n) / 7000.0 + rng.uniform(0, 6))
    if crossing:
        speed = 150.0 * np.sin(2 * np.pi * np.arange(n) / n)
    level = np.full(n, TORQUE)
    for index, size in jumps:
        level[index:] += size * SIGMA
    e = SIGMA * rng.standard_normal(n) if noise is None else noise(rng, n)
    return speed, np.sign(speed) * (level + WHEEL.nominal.viscous_Nm_s_rad * np.abs(speed)) + e, np.ones(n, dtype=bool)


def _ar(rng, n):
    return SIGMA * signal.lfilter([np.sqrt(0.75)], [1, -0.5], rng.standard_normal(n + 200))[200:]


def _student(rng, n):
    return SIGMA / np.sqrt(3) * rng.standard_t(3, n)


def _gather(speed, torque, good, cuts=(), wheel=WHEEL, **kwargs):
    window = WindowAccumulator(wheel, slots=speed.size, **kwargs)
    events = []
    for part in np.split(np.arange(speed.size), cuts):
        events += window.append(speed[part], torque[part], good[part])
    return window.close(), events


def _bytes(evidence):
    """Return everything in the evidence that could differ."""
    candidates, structure = evidence.candidates, evidence.structure
    arrays = (candidates.index, candidates.scale, candidates.statistic, candidates.jump, evidence.noise.autocovariance)
    at = np.arange(0, evidence.slots, 37)
    moments = evidence.sums.between(np.zeros_like(at), at)
    return (
        b"".join(array.tobytes() for array in arrays)
        + moments.tobytes()
        + b"".join(getattr(structure, name).tobytes() for name in ("near_zero", "ripple", "direction"))
        + np.array([evidence.noise.std, evidence.noise.long_run_factor]).tobytes()
        + repr((evidence.slots, evidence.good, evidence.used, structure.zero_runs, structure.plateaus)).encode()
    )


# ---- arrival ---------------------------------------------------------------------------------------------------------


@given(
    seed=st.integers(0, 2**31),
    n=st.integers(0, 5 * CHUNK),
    cuts=st.lists(st.integers(0, 5 * CHUNK), max_size=12),
    share=st.sampled_from([1.0, 0.9, 0.02]),
    wheel=st.sampled_from([WHEEL, Wheel(name="bare", sample_period_s=0.125)]),
    crossing=st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_any_cut_gives_the_same_evidence_and_events(seed, n, cuts, share, wheel, crossing):
    jumps = [(k, 15.0) for k in range(700, n, 1000)] + [(k, -15.0) for k in range(703, n, 1300)]
    speed, torque, good = _telemetry(seed, n, jumps, crossing=crossing)
    good = np.random.default_rng(seed).random(n) < share
    _compare_cut(speed, torque, good, np.sort(np.minimum(cuts, n)), wheel)


def test_a_window_with_far_too_many_peaks_is_pruned_alike_in_any_cut():
    speed, torque, good = _telemetry(21, 30_000)
    torque += 20 * SIGMA * np.random.default_rng(21).integers(0, 2, 30_000)
    _compare_cut(speed, torque, good, np.arange(97, 30_000, 97), WHEEL)


def _compare_cut(speed, torque, good, cuts, wheel):
    whole, events = _gather(speed, torque, good, wheel=wheel)
    pieces, others = _gather(speed, torque, good, cuts, wheel=wheel)
    assert _bytes(pieces) == _bytes(whole)
    assert others == events


# ---- what is found ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sojourn", [1, 2, 3, 5, 10, 50, 200])
@pytest.mark.parametrize("size", [12.5, 25.0])
@pytest.mark.parametrize("noise", [None, _ar], ids=["white", "AR(0.5)"])
def test_short_sojourns_of_example_1_are_found_in_place(sojourn, size, noise):
    starts = np.arange(1500, 10_000, 1500)
    jumps = [(int(k), size) for k in starts] + [(int(k) + sojourn, -size) for k in starts]
    evidence, _ = _gather(*_telemetry(sojourn, 10_000, jumps, noise))
    found = set(evidence.candidates.index.tolist())
    true = {index for index, _ in jumps}
    assert all(min(abs(k - j) for j in found) <= 1 for k in true)
    assert len(found - true) <= 3


@pytest.mark.parametrize("noise", [None, _ar, _student], ids=["white", "AR(0.5)", "Student t"])
def test_jumps_of_systems_that_switch_often_are_not_mistaken_for_noise(noise):
    n, rest, active = 20_000, 200.0, 20.0  # without the systems' durations 62, 85 and 82 % of the jumps are found
    rng = np.random.default_rng(11)
    true = np.cumsum(3 + np.column_stack([rng.geometric(1 / rest, n), rng.geometric(1 / active, n)]))
    true = true[true < n - 4]
    jumps = [(int(slot), (15.0, -15.0)[k % 2]) for k, slot in enumerate(true)]
    system = SwitchingSystem(name="fss_1", durations=(Geometric(mean_slots=rest), Geometric(mean_slots=active)))
    evidence, _ = _gather(*_telemetry(11, n, jumps, noise), wheel=WHEEL.model_copy(update={"fss": (system,)}))
    apart = np.abs(true[:, None] - evidence.candidates.index)
    assert (apart.min(axis=1) <= 1).mean() > 0.97
    assert (apart.min(axis=0) <= 1).mean() > 0.95


@pytest.mark.parametrize("noise", [None, _ar, _student], ids=["white", "AR(0.5)", "Student t"])
def test_windows_without_a_jump_give_few_candidates(noise):
    """0.3 by chance per window are wanted; ten windows with more than 13 have probability below 1e-4."""
    false = sum(len(_gather(*_telemetry(seed, 40_000, noise=noise))[0].candidates) for seed in range(10))
    assert false <= 13


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_both_directions_and_a_zero_crossing(direction):
    jumps = [(3000, 15.0), (11_000, -10.0)]
    speed, torque, good = _telemetry(3, 16_000, jumps, crossing=True)
    evidence, _ = _gather(direction * speed, direction * torque, good)
    assert evidence.candidates.index.tolist() == [3000, 11_000]
    np.testing.assert_allclose(evidence.candidates.jump / (SIGMA / TORQUE), [15.0, -10.0], atol=0.3)
    # χ² of the whole halves, of 1024 samples each at most, over the variance of contrasts of 128.
    np.testing.assert_allclose(evidence.candidates.statistic, [512 * 15.0**2, 512 * 10.0**2], rtol=0.5)
    assert evidence.used == int((np.abs(speed) >= 1.0).sum())


def test_without_nominal_values_and_noise_jumps_are_found_all_the_same():
    speed, torque, good = _telemetry(7, 6000, [(3000, 15.0)])
    evidence, _ = _gather(speed, torque, good, wheel=Wheel(name="bare", sample_period_s=0.125))
    assert [k for k in evidence.candidates.index if abs(k - 3000) <= 2]
    assert evidence.noise.std == pytest.approx(SIGMA, rel=0.05)  # N m: nothing to normalise by


@pytest.mark.parametrize("middle", [0.1, 0.3])
def test_samples_that_average_over_a_reversal_are_no_sojourns(middle):
    """A sensor that averages reads anything between both directions where the wheel passes zero within a sample."""
    n, per_sample = 8000, 4.0  # rad/s that the speed changes by
    turned = np.abs((np.arange(n) + middle) % 200 - 100) - 50.0
    fine = np.abs((np.arange(50 * n) / 50 + middle - 0.5 + 0.01) % 200 - 100) - 50.0
    side = np.sign(fine).reshape(n, 50).mean(axis=1)
    speed = per_sample * turned + 1e-3 * np.random.default_rng(4).standard_normal(n)
    torque = TORQUE * side + WHEEL.nominal.viscous_Nm_s_rad * speed
    torque += SIGMA * np.random.default_rng(5).standard_normal(n)
    evidence, _ = _gather(speed, torque, np.ones(n, dtype=bool))
    assert len(evidence.candidates) == 0
    assert evidence.good == n
    assert evidence.used > 0.97 * n


def test_masked_and_broken_samples_hold_their_slots():
    speed, torque, good = _telemetry(20, 6000, [(3000, 15.0), (4500, -15.0)])
    good[np.random.default_rng(8).random(6000) < 0.1] = False
    good[2000:2400] = False
    good[[3000, 4500]] = True
    torque[~good] = np.nan
    good[[1000, 1001]] = True
    torque[1000], speed[1001] = 1e30, -1e12  # broken words of telemetry are no samples
    evidence, _ = _gather(speed, torque, good)
    assert evidence.candidates.index.tolist() == [3000, 4500]
    assert evidence.good == evidence.used == int(good.sum()) - 2


@pytest.mark.parametrize(
    ("seed", "n", "jumps", "noise", "quantum", "reach", "most"),
    [
        (10, 40_000, [(20_000, 10.0)], _student, 0.0, 3, 6),
        (22, 40_000, [(20_000, 15.0), (30_000, -10.0)], None, 0.5, 1, 4),
        (22, 40_000, [(20_000, 15.0), (30_000, -10.0)], None, 2.0, 1, 4),
        (12, 5_000, [(2_500, 10.0)], lambda rng, n: np.zeros(n), 0.0, 0, 1),
    ],
    ids=["heavy tails", "half a sigma", "two sigma", "no noise"],
)
def test_tails_and_quantisation_do_not_become_jumps(seed, n, jumps, noise, quantum, reach, most):
    speed, torque, good = _telemetry(seed, n, jumps, noise)
    if quantum:
        torque = quantum * SIGMA * np.round(torque / (quantum * SIGMA))
    evidence, events = _gather(speed, torque, good)
    candidates = evidence.candidates
    assert all(np.abs(candidates.index - jump).min() <= reach for jump, _ in jumps)
    assert len(candidates) <= most
    assert len(events) <= 4
    assert np.isfinite(candidates.statistic).all()


@pytest.mark.parametrize("n", [0, 1, 17, 63, 64, 65, 300, CHUNK - 1, CHUNK, CHUNK + 1])
def test_short_and_empty_windows_close(n):
    speed, torque, good = _telemetry(11, n)
    evidence, _ = _gather(speed, torque, good)
    assert evidence.slots == n
    assert evidence.noise.std > 0
    assert len(evidence.candidates) <= 2
    nothing, _ = _gather(speed, torque, np.zeros(n, dtype=bool))
    assert nothing.used == 0
    assert len(nothing.candidates) == 0


@pytest.mark.parametrize("joint", range(1, 7))
@pytest.mark.measured
@pytest.mark.skipif(MEASURED is None, reason="RWA_MEASURED_DATA does not say where the measured tables are")
def test_measured_joints_have_the_published_viscous_friction(joint):
    """TX40: least squares over our used samples gives the coefficients of an independent fit (see its README)."""
    published = (8.05, 5.53, 1.97, 1.11, 1.86, 0.65)[joint - 1]
    folder = Path(MEASURED) / "tx40"
    wheel = Wheel.from_toml((folder / "wheel.toml").read_text(), "wheel.toml")
    table = np.genfromtxt(folder / f"joint{joint}.csv", delimiter=",", names=True)
    speed, torque = table["speed_rad_s"], table["friction_torque_Nm"]
    evidence, _ = _gather(speed, torque, np.ones(speed.size, dtype=bool), wheel=wheel)
    fit = estimate(evidence, np.zeros(0, dtype=np.int64))
    # The published fit has an offset too, and joint 6 a second speed.
    assert fit.viscous == pytest.approx(published, rel=0.04)
    assert evidence.noise.std < fit.rmse < 1.5 * evidence.noise.std


# ---- live ------------------------------------------------------------------------------------------------------------


def test_a_jump_is_confirmed_soon_after_it_happened():
    speed, torque, good = _telemetry(13, 6000, [(3000, 15.0)])
    window = WindowAccumulator(WHEEL, slots=6000)
    events = []
    for start in range(0, 6000, BLOCK):
        part = slice(start, start + BLOCK)
        events += [(event, start + BLOCK) for event in window.append(speed[part], torque[part], good[part])]
    [(event, when)] = events
    assert event.index == 3000
    assert when - event.index <= 2 * BLOCK
    assert event.jump == pytest.approx(15.0 * SIGMA / TORQUE, abs=4 * event.std)
    assert event.confidence > 0.99


def test_confirmed_candidates_are_those_of_the_close():
    jumps = [(k, 14.0 * (-1) ** i) for i, k in enumerate(range(1200, 20_000, 700))]
    evidence, events = _gather(*_telemetry(14, 20_000, jumps))
    assert {event.index for event in events} <= set(evidence.candidates.index.tolist())
    assert len(events) >= 0.95 * len(jumps)


# ---- cost ------------------------------------------------------------------------------------------------------------


def test_the_close_reads_a_few_samples_around_peaks_only():
    """It finds the same when all others are lost once they have been gathered."""
    samples = _telemetry(15, 80_000, [(5000, 15.0), (5100, -15.0), (15_000, 20.0)])
    window = WindowAccumulator(WHEEL, slots=80_000)
    window.append(*samples)
    lost = np.ones(80_000, dtype=np.bool_)
    for k in window._window.peaks_above(18.0, window._window.variances)[0].tolist():
        lost[k - 1100 : k + 1100] = False  # halves of 1024 slots at most, and what lies beside a checkpoint
    assert np.mean(lost) > 0.5
    window._x[lost] = window._z[lost] = np.nan
    found, expected = window.close().candidates, _gather(*samples)[0].candidates
    assert len(found) == 3
    for name in Candidates.__slots__:
        assert getattr(found, name).tobytes() == getattr(expected, name).tobytes()


def test_a_window_of_80000_slots_fits_in_three_megabytes():
    speed, torque, good = _telemetry(16, 80_000, [(k, 15.0 * (-1) ** k) for k in range(3001, 80_000, 3001)])
    _gather(speed[:5000], torque[:5000], good[:5000])  # compiled code is not the window's
    tracemalloc.start()
    window = WindowAccumulator(WHEEL, slots=80_000)
    window.append(speed, torque, good)
    evidence = window.close()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(evidence.candidates) >= 20
    # What compiled code may hold beside: peaks, histogram, prefix sums.
    assert peak + 40 * MOST_PEAKS + 0.28e6 < 3e6


# ---- what hides jumps, or looks like them ----------------------------------------------------------------------------


@pytest.mark.parametrize("gap", [14, 80, 300, 2000])
def test_a_jump_in_a_gap_is_found_behind_it(gap):
    speed, torque, good = _telemetry(11, 20_000, jumps=[(9_000, 8.0)])
    good[9_000 - gap // 2 : 9_000 + gap // 2] = False
    assert _gather(speed, torque, good)[0].candidates.index.tolist() == [9_000 + gap // 2]
    speed, torque, _ = _telemetry(11, 20_000)
    assert len(_gather(speed, torque, good)[0].candidates) == 0


@pytest.mark.parametrize(("first", "last"), [(1.0, 1.0), (1.0, 1.25), (1.0, 1.5), (2.5, 2.5)])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_slews_of_a_wheel_whose_viscous_friction_is_anomalous_are_no_jumps(first, last, seed):
    """The nominal slope, or the one learned of the window's beginning, is wrong by a quarter and more."""
    n = 20_000
    rng = np.random.default_rng(seed)
    at = np.arange(n)
    targets = rng.uniform(20.0, 280.0, size=12)
    speed = np.interp(at, np.arange(24) * n / 24, np.repeat(targets, 2))  # a dwell, a slew, a dwell …
    slope = WHEEL.nominal.viscous_Nm_s_rad * np.interp(at, [0.2 * n, 0.7 * n], [first, last])
    jumps = [(5_000, 20.0), (12_000, -15.0)]
    level = TORQUE + SIGMA * sum(size * (at >= index) for index, size in jumps)
    torque = level + slope * speed + SIGMA * rng.standard_normal(n)
    _, events = _gather(speed, torque, np.ones(n, dtype=bool))
    assert len(events) == len(jumps)
    for event, (index, size) in zip(events, jumps, strict=True):
        assert abs(event.index - index) <= 2
        assert abs(event.jump * TORQUE / SIGMA - size) < 5.0 * event.std * TORQUE / SIGMA + 0.3


def test_without_another_viscous_speed_viscous_friction_is_in_proportion_to_the_speed():
    """As of a wheel that lacks the effect, in any cut: as where no temperature came."""
    law = {"strength_Nm_s_rad": 5.333e-6, "activation_temperature_K": 4000.0}
    tables = WHEEL.to_tables() | {"effect": [{"name": "viscosity_temperature", "parameters": law}]}
    speed, torque, good = _telemetry(3, 5000, jumps=((2000, 0.5),))
    plain, _ = _gather(speed, torque, good)
    follows, _ = _gather(speed, torque, good, cuts=(0, 1, 3, 700), wheel=Wheel.from_tables(tables, "test"))
    assert follows.heat is None
    assert follows.candidates.index.tolist() == plain.candidates.index.tolist() != []
    assert follows.noise.std == plain.noise.std
