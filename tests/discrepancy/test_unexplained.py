"""What no effect explains: a level that creeps is no switching system, and many true jumps are no creeping."""

import numpy as np
import pytest
from scipy import signal

from rwa_monitor.discrepancy.extended import extended_wheel
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.plan import plan
from rwa_monitor.discrepancy.unexplained import with_nonparametric_curves
from rwa_monitor.discrepancy.unnamed import OFFSET_DIFFERS, VISCOUS_DIFFERS
from rwa_monitor.reporting.discrepancy_report import sentence
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.wheel import Wheel
from tests.discrepancy.simple import DRY_NM, NOISE_NM, PERIOD_S, VISCOUS, WHEEL, Array, names, record, search, swing
from tests.discrepancy.smooth import null_record, problem_of, smooth_record, two_sines

COUNT, SHORT = 8000, 4000
# A wheel of which no switching system is known, as one that has just been put on the bench.
UNKNOWN: Wheel = WHEEL.model_copy(update={"fss": ()})


@pytest.mark.parametrize(("bend", "is_near"), [(0.3, True), pytest.param(0.0, False, marks=pytest.mark.slow)])
def test_the_effect_that_explains_a_part_of_an_unknown_drag_is_reported_with_its_share(
    bend: float, is_near: bool
) -> None:
    speed = two_sines(2000 if is_near else SHORT)
    size = np.abs(speed)
    waves, curve = np.sin(size / (12.0 if is_near else 15.0)), bend * (size / 200.0) ** 2
    drag = np.sign(speed) * DRY_NM * (curve + (0.1 if is_near else 0.2) * waves)
    found = search(smooth_record(speed, drag, seed=3), UNKNOWN).result
    assert found.unexplained.signature == "a drag that depends on |speed|"
    nearest = found.unexplained.nearest
    assert (nearest is not None) == is_near
    if is_near:  # dry and viscous friction take the most of the curve
        assert 0.1 < nearest.share < 0.7
        assert f"{nearest.effect} comes nearest, with {nearest.share:.0%}" in sentence(found)


@pytest.mark.parametrize("forgets_after", [150, 600])  # slots
def test_a_drag_that_wanders_is_not_explained_away_by_noise_or_small_steps(forgets_after: int) -> None:
    kept = np.exp(-1 / forgets_after)
    draws = np.random.default_rng(3).normal(size=SHORT)
    walk = 3 * NOISE_NM * np.sqrt(1 - kept**2) * signal.lfilter([1.0], [1.0, -kept], draws)
    result = search(record(swing(SHORT), (), lambda speed, _: walk * np.sign(speed))[0], UNKNOWN).result
    assert result.verdict == "inadequate"
    assert "wanders" in result.unexplained.signature
    assert 0.4 * walk.std() < result.unexplained.size_Nm < 1.1 * walk.std()


@pytest.mark.parametrize("autocorrelation", [pytest.param(0.5, marks=pytest.mark.slow), 0.95])
def test_noise_that_forgets_is_no_wandering(autocorrelation: float) -> None:
    white = np.sqrt(1 - autocorrelation**2) * np.random.default_rng(4).normal(size=COUNT)
    noise = NOISE_NM * signal.lfilter([1.0], [1.0, -autocorrelation], white)
    assert search(record(swing(COUNT), (), noise=noise)[0], UNKNOWN).result.unexplained is None


def test_many_true_jumps_are_no_wandering() -> None:
    result = search(record(swing(COUNT), tuple(range(500, 7600, 600)))[0], UNKNOWN).result
    assert result.unexplained is None
    assert result.gain.changepoints_extended == 12


def test_a_drift_that_grows_ever_faster_is_not_explained_away_by_jumps() -> None:
    count = 20_000
    time_s = np.arange(count) * PERIOD_S
    ramp = 3.0e-4 * np.clip((time_s - 1000.0) / 1500.0, 0.0, None) ** 2
    jumps = (6000, 11_000, 16_500)
    result = search(record(swing(count), jumps, lambda speed, _: ramp * np.sign(speed))[0]).result
    assert result.verdict == "inadequate"
    assert "drifts with time" in result.unexplained.signature
    beside_levels = np.concatenate([part - part.mean() for part in np.split(ramp, jumps)])
    assert result.unexplained.size_Nm == pytest.approx(beside_levels.std(), rel=0.1)


def test_the_period_of_a_short_rub_is_reported_not_that_of_a_harmonic() -> None:
    count = 20_000
    rub = 2 * NOISE_NM * (np.mod(np.arange(count) * PERIOD_S, 130.0) < 6.0)
    result = search(record(swing(count), effect=lambda speed, _: rub * np.sign(speed))[0]).result
    assert "periodic in time, every 130 s" in result.unexplained.signature
    assert 0.6 * rub.std() < result.unexplained.size_Nm < 1.5 * rub.std()


def test_a_short_record_that_wanders_is_periodic_with_nothing_longer_than_itself() -> None:
    samples = null_record("two sines", 0.999, seed=8)
    fitting = Fitting(problem_of(samples), jumps=False)
    periods = [
        1.0 / model.terms[-1].shape["frequency_Hz"]
        for model in with_nonparametric_curves(fitting, fitting.base())
        if "frequency_Hz" in model.terms[-1].shape
    ]
    assert len(periods) == 3
    assert max(periods) < len(samples) * PERIOD_S / 4.0


def test_what_repeats_with_the_motion_is_not_called_periodic_in_time() -> None:
    speed = swing(period_s=170.0)
    bend = 3 * NOISE_NM * np.sin(speed / 10.0)  # no law of the catalogue
    result = search(record(speed, (), lambda speed, _: bend * np.sign(speed))[0]).result
    assert result.verdict == "inadequate"
    assert "periodic in time" not in (result.unexplained.signature if result.unexplained else "")


# ---- drag that jumps at moments of its own, beside the dry friction's jumps ------------------------------------------


JUMPS = (1500, 3100)
POCKETS = (600, 1900, 2700, 3400)
SLOPES = (800, 1900, 2900)


def pockets(speed: Array, height: float, seconds: float) -> Array:
    """Return the drag of pockets of oil that are run over and squeezed out again [N m]."""
    drag = np.zeros(speed.size)
    for k, at in enumerate(POCKETS):
        drag[at:] += (1.0 + 0.2 * k) * height * np.exp(-np.arange(speed.size - at) * PERIOD_S / seconds)
    return np.asarray(drag * np.sign(speed))


@pytest.mark.parametrize(
    ("height", "seconds", "seed"), [(0.3, 25.0, 0), pytest.param(0.15, 60.0, 1, marks=pytest.mark.slow), (0.3, 8.0, 2)]
)
def test_pockets_of_oil_are_jumps_that_relax_and_no_further_system(height: float, seconds: float, seed: int) -> None:
    samples, _ = record(swing(SHORT), JUMPS, lambda speed, _: pockets(speed, height * DRY_NM, seconds), seed=seed)
    found = search(samples)
    assert names(found) == ["decaying_jump"]
    (effect,) = found.result.effects
    assert effect.parameters["time_constant_s"].value == pytest.approx(seconds, rel=0.25)
    (relaxing,) = (term for term in found.extended.terms if term.effect.name == "decaying_jump")
    heights = found.extended.strengths(found.extended.names.index("decaying_jump"))
    assert relaxing.columns.shape[1] == len(POCKETS)
    np.testing.assert_allclose(heights, height * DRY_NM * (1.0 + 0.2 * np.arange(len(POCKETS))), rtol=0.15)
    assert [block.name for block in extended_wheel(found).effect] == ["decaying_jump"]
    gain = found.result.gain  # held out and simulated, the jumps of the records are fitted, as their levels are
    assert not gain.is_a_loss
    assert not gain.simulated.is_a_loss
    assert gain.rmse_extended_Nm < 1.05 * NOISE_NM


@pytest.mark.parametrize(
    ("viscous", "offset", "signature"),
    [
        ((1.0, 1.1), (0.0, 0.0), VISCOUS_DIFFERS),
        ((1.0, 1.0), (0.0, 0.1), OFFSET_DIFFERS),
        ((1.0, 1.0), (0.05, 0.05), None),
    ],
)
def test_what_differs_between_recordings_is_reported_and_is_no_noise(
    viscous: tuple[float, float], offset: tuple[float, float], signature: str | None
) -> None:
    def recording(number: int) -> Samples:
        added, torque = (viscous[number] - 1.0) * VISCOUS, offset[number] * DRY_NM
        return record(swing(1500, period_s=150.0), (), lambda speed, _: added * speed + torque, seed=number)[0]

    result = find_discrepancy([("first", recording(0)), ("second", recording(1))], UNKNOWN).result
    assert (result.unexplained and result.unexplained.signature) == signature
    assert [effect.name for effect in result.effects] == ([] if signature else ["torque_bias"])


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_slope_that_jumps_by_itself_is_named(seed: int) -> None:
    slope = 0.5 * VISCOUS * (np.searchsorted(SLOPES, np.arange(SHORT), side="right") % 2)
    samples, _ = record(swing(SHORT), JUMPS, lambda speed, _: slope * speed, seed=seed)
    assert names(search(samples)) == ["viscous_jump"]


@pytest.mark.parametrize("seed", range(3))
def test_levels_alone_show_no_such_jumps(seed: int) -> None:
    named = names(search(record(swing(SHORT), (700, 1500, 2300, 3100), seed=seed)[0]))
    assert not {"decaying_jump", "viscous_jump"} & set(named)


# ---- drag that decays with the angle turned since a reversal is named, and is no set of names that fit together ------


def runs(seed: int) -> Array:
    """Return runs of a few minutes in one direction and then the other, at speeds that differ and wander [rad/s]."""
    rng = np.random.default_rng(seed)
    ends = np.cumsum(rng.integers(500, 1100, 16))
    speeds = rng.uniform(60.0, 220.0, ends.size) * np.where(np.arange(ends.size) % 2, -1.0, 1.0)
    at = np.stack([ends - 150, ends], axis=1).ravel()
    motion = np.interp(np.arange(COUNT), at, np.stack([np.append(90.0, speeds[:-1]), speeds], axis=1).ravel())
    return np.asarray(motion * (1.0 + 0.1 * np.sin(2 * np.pi * np.arange(COUNT) * PERIOD_S / 37.0)))


@pytest.mark.parametrize(("seed", "turns", "viscous"), [(50400, 300.0, False), (50401, 150.0, True)])
def test_grease_that_channels_after_each_reversal_is_reported_with_the_turns_it_takes(
    seed: int, turns: float, viscous: bool
) -> None:
    def churning(speed: Array, _: Array) -> Array:
        left, drag = 0.0, np.empty(speed.size)
        for k, now in enumerate(speed):
            if k and now * speed[k - 1] < 0:
                left = 1.0
            left *= np.exp(-abs(now) * PERIOD_S / (2 * np.pi * turns))
            drag[k] = 3e-4 * left * (now / 100.0 if viscous else np.sign(now))
        return drag

    found = search(record(runs(seed), effect=churning, seed=seed)[0])
    assert not found.result.effects
    words = found.result.unexplained.signature
    assert "decays with the angle turned since each reversal" in words
    assert float(words.split("over about ")[1].split(" turns")[0]) == pytest.approx(turns, rel=0.15)
    assert any("does it decay with turns or with time?" in line for line in plan(found).advice)


def test_reversals_without_grease_show_nothing() -> None:
    assert search(record(runs(50402), seed=50402)[0]).result.verdict == "adequate"
