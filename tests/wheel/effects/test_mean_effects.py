"""What every mean effect of the catalogue must do, tried on all of them; the rule for gaps of those that remember."""

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import optimize

from rwa_monitor.kernels.effects import dahl_bristle, first_order_lag
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect
from rwa_monitor.wheel.effects.catalogue import MEAN_EFFECTS
from rwa_monitor.wheel.effects.formula import FORMULAS
from rwa_monitor.wheel.effects.torque_balance_errors import CurrentDelay
from rwa_monitor.wheel.effects.torque_ripple import angle_turned
from tests.wheel.effects.records import channels_of, mirrored, piece, rich_motion

ALL = sorted(MEAN_EFFECTS.values(), key=lambda effect: effect.name)
GRID = 60  # start values of a profiled shape: a dead zone's sum of squares is a staircase with many local minima
every_mean_effect = pytest.mark.parametrize("effect", ALL, ids=lambda effect: effect.name)
every_column = pytest.mark.parametrize("effect", [*ALL, *FORMULAS.values()], ids=lambda effect: effect.name)


@every_mean_effect
def test_a_strength_at_the_end_of_its_range_is_no_finding(effect: type[MeanEffect]) -> None:
    friction = 4.8e-4, 5.333e-6  # dry [N m], viscous [N m s/rad]
    inside = np.array([parameter.typical for parameter in effect.strength_parameters()])
    assert effect.is_possible(inside, *friction)
    assert effect.is_possible(np.zeros(inside.size), *friction)
    for i, parameter in enumerate(effect.strength_parameters()):
        if np.isfinite(parameter.high):
            assert not effect.is_possible(np.where(np.arange(inside.size) == i, parameter.high, inside), *friction)


def test_drag_that_trails_is_not_many_times_the_viscous_friction() -> None:
    lag = MEAN_EFFECTS["lubricant_lag"]
    assert lag.is_possible(np.array([-1.1e-5]), 4.8e-4, 5.333e-6)
    assert not lag.is_possible(np.array([-6e-3]), 4.8e-4, 3.8e-5)


def test_static_friction_is_not_many_times_the_dry_friction() -> None:
    stribeck = MEAN_EFFECTS["stribeck"]
    assert stribeck.is_possible(np.array([4.8e-4]), 4.8e-4, 0.0)
    assert not stribeck.is_possible(np.array([4.8e-3]), 4.8e-4, 0.0)
    assert not stribeck.is_possible(np.array([4.8e-4]), 0.0, 5.333e-6)


def test_friction_runs_in_over_an_hour_or_longer() -> None:
    drift = MEAN_EFFECTS["run_in_drift"]
    channels = rich_motion(2048)
    assert drift.largest_share(channels) == pytest.approx(2048 * channels.sample_period_s / 3600.0)
    assert drift.largest_share(replace(channels, sample_period_s=60.0)) == 1.0


@every_column
@pytest.mark.parametrize("seed", range(3))
def test_a_record_in_pieces_gives_the_same_bits(effect: type[MeanEffect], seed: int) -> None:
    rng = np.random.default_rng(seed)
    channels = with_gaps(rich_motion(64 * 40, seed=seed), rng)
    shape = effect.typical().shape
    whole, last = effect.columns(channels, shape)
    cuts = [0, *sorted(64 * rng.choice(np.arange(1, 40), size=7, replace=False)), len(channels)]
    parts, memory = [], None
    for start, stop in pairwise(cuts):
        part, memory = effect.columns(piece(channels, start, stop), shape, memory)
        parts.append(part)
    assert np.array_equal(np.concatenate(parts), whole, equal_nan=True)
    assert (memory is None) == (last is None)
    if memory is not None and last is not None:
        assert np.array_equal(memory, last, equal_nan=True)


def with_gaps(channels: Channels, rng: np.random.Generator) -> Channels:
    """Return the record with 5 % of the slots unknown in every channel, the first ones among them."""
    gone = rng.random(len(channels)) < 0.05
    gone[:3] = True

    measured = ("speed_rad_s", "direction", "acceleration_rad_s2", "angle_rad", "motor_torque_Nm")
    holed = {name: np.where(gone, np.nan, getattr(channels, name)) for name in (*measured, "bearing_temperature_degC")}
    return replace(channels, good=~gone, **holed)


@every_mean_effect
def test_a_gap_hides_its_own_slots_only(effect: type[MeanEffect]) -> None:
    channels = rich_motion(2048)
    shape = effect.typical().shape
    holed = with_gaps(channels, np.random.default_rng(5))
    columns, _ = effect.columns(holed, shape)
    assert np.isfinite(columns[holed.good]).all()
    if effect.name not in ("torque_bias", "run_in_drift"):  # these need no channel with gaps, or only the direction
        assert np.isnan(columns[~holed.good]).all()


@every_mean_effect
def test_a_missing_channel_gives_nan_not_a_guess(effect: type[MeanEffect]) -> None:
    bare = replace(rich_motion(256), **dict.fromkeys(effect.needs))
    columns, _ = effect.columns(bare, effect.typical().shape)
    assert np.isnan(columns).all() == bool(effect.needs)


@every_column
def test_parity_is_as_stated(effect: type[MeanEffect]) -> None:
    channels = rich_motion(1024)
    shape = effect.typical().shape
    there, _ = effect.columns(channels, shape)
    back, _ = effect.columns(mirrored(channels), shape)
    odd, even = np.allclose(back, -there, atol=1e-12), np.allclose(back, there, atol=1e-12)
    assert (odd, even) == {"odd": (True, False), "even": (False, True), "none": (False, False)}[effect.parity]


@every_mean_effect
@pytest.mark.parametrize("noise_share", [0.0, 0.02], ids=["exact", "noisy"])
def test_simulate_then_fit_gives_the_parameters_back(effect: type[MeanEffect], noise_share: float) -> None:
    """Fit dry sign, slope and the effect together; the bound on the noisy fit is five standard deviations."""
    rng = np.random.default_rng(3)
    channels = rich_motion(8192)
    truth = draw(effect, channels, rng)
    torque, _ = truth.torque(channels)
    noise = noise_share * np.sqrt(np.mean(torque**2))
    base = np.stack([channels.direction * channels.dry_level_Nm, channels.speed_rad_s], axis=1)
    y = base @ [1.0, 5.333e-6] + torque + noise * rng.normal(size=torque.size)
    fitted, strengths, residual = fit_profiled(effect, channels, base, y)
    expected = np.array([truth.values[p.name] for p in effect.strength_parameters()])
    if noise_share == 0.0:
        assert residual < 1e-3 * np.sqrt(np.mean(torque**2))
        for name, value in truth.shape.items():
            assert fitted[name] == pytest.approx(value, rel=2e-2)
        np.testing.assert_allclose(strengths, expected, rtol=5e-2, atol=1e-3 * np.abs(expected).max())
    else:
        recovered = effect.columns(channels, fitted)[0] @ strengths
        # The fitted torque may differ from the true one by the noise that so many parameters carry.
        freedom = len(effect.parameters) + 2
        apart = remove(recovered - torque, base)
        assert np.sqrt(np.sum(apart**2)) < 5 * noise * np.sqrt(freedom)


def draw(effect: type[MeanEffect], channels: Channels, rng: np.random.Generator) -> MeanEffect:
    """Return an effect with strengths at twice the typical (within bounds) and shapes well inside what shows."""
    values = {}
    bounds = effect.shape_bounds(channels)
    for parameter in effect.parameters:
        if parameter.linear:
            values[parameter.name] = np.clip(2 * (parameter.typical or 1e-4), parameter.low, parameter.high)
        elif parameter.choices:
            values[parameter.name] = parameter.typical
        else:
            low, high = bounds[parameter.name]
            values[parameter.name] = float(np.exp(np.log(low) + rng.uniform(0.4, 0.6) * np.log(high / low)))
    return effect(**values)


def remove(values: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Return what is left of values after a least-squares fit of the base columns."""
    scaled = base / np.linalg.norm(base, axis=0)
    return values - scaled @ np.linalg.lstsq(scaled, values, rcond=None)[0]


def fit_profiled(
    effect: type[MeanEffect], channels: Channels, base: np.ndarray, y: np.ndarray
) -> tuple[dict[str, float], np.ndarray, float]:
    """Return shape, strengths and RMS residual of the least-squares fit with profiled shape parameters."""
    target, bounds = remove(y, base), effect.shape_bounds(channels)
    discrete = [p for p in effect.shape_parameters() if p.choices]

    def solve(shape: dict[str, float]) -> tuple[float, np.ndarray]:
        columns = effect.columns(channels, shape)[0]
        left = np.stack([remove(c, base) for c in columns.T], axis=1)
        norms = np.linalg.norm(left, axis=0)
        norms[norms == 0] = 1.0
        coefficients = np.linalg.lstsq(left / norms, target, rcond=None)[0]
        return float(np.sqrt(np.mean((target - left / norms @ coefficients) ** 2))), coefficients / norms

    shapes = [dict(zip([p.name for p in discrete], c, strict=True)) for c in product(*(p.choices for p in discrete))]
    for parameter in effect.shape_parameters():
        if parameter.choices:
            continue
        ends = tuple(np.log(bounds[parameter.name]))
        for shape in shapes:
            cost = lambda g, of=shape, name=parameter.name: solve({**of, name: float(np.exp(g[0]))})[0]  # noqa: E731
            shape[parameter.name] = float(np.exp(optimize.brute(cost, [ends], Ns=GRID, finish=optimize.fmin)[0]))
    best = min(shapes, key=lambda shape: solve(shape)[0])
    residual, strengths = solve(best)
    return best, strengths, residual


# ---- those that remember, over gaps ----------------------------------------------------------------------------------


def start() -> FloatArray:
    return np.full(2, np.nan)


SPEEDS = np.concatenate([np.linspace(3.0, -3.0, 200), np.zeros(5), np.linspace(0.0, 2.0, 60)])


def test_the_state_is_held_through_a_gap() -> None:
    """A gap of any length leaves the state as it was: the slots after it are those of the record without the gap."""
    usable = np.ones(SPEEDS.size, dtype=bool)
    usable[50:90] = False
    holed = np.where(usable, SPEEDS, np.nan)
    for kernel, arguments in ((first_order_lag, (0.125, 4.0)), (dahl_bristle, (0.125, 0.02))):
        with_gap = kernel(holed, usable, *arguments, start())
        joined = kernel(SPEEDS[usable], np.ones(usable.sum(), dtype=bool), *arguments, start())
        assert np.array_equal(with_gap[usable], joined)
        assert (with_gap[50:90] == with_gap[49]).all()


def test_a_rate_across_a_gap_is_over_the_time_since() -> None:
    torque = np.array([0.0, 1.0, np.nan, np.nan, 7.0])
    rate = CurrentDelay.columns(channels_of(np.ones(5), 0.5, motor_torque_Nm=torque), {})[0][:, 0]
    assert rate[[0, 1, 4]].tolist() == [0.0, 2.0, 4.0]
    assert np.isnan(rate[2:4]).all()


def test_the_wheel_turns_on_through_a_gap() -> None:
    """Where the speed changes evenly, the angle after a gap is that without it."""
    speed = np.linspace(10.0, 40.0, 64)
    usable = np.ones(64, dtype=bool)
    usable[20:31] = False
    whole, _ = angle_turned(channels_of(speed))
    holed, _ = angle_turned(channels_of(np.where(usable, speed, np.nan)))
    assert whole[-1] == pytest.approx(25.0 * 63 * 0.125, rel=1e-12)
    np.testing.assert_allclose(holed[usable], whole[usable], rtol=1e-12)


@given(
    st.lists(st.floats(-700, 700), min_size=2, max_size=60),
    st.floats(1e-5, 1.0),
    st.floats(1e-3, 1.0),
)
def test_the_bristle_never_leaves_its_range(speeds: list[float], scale_rad: float, period_s: float) -> None:
    """Explicit integration would blow up at speed; the exact step cannot."""
    values = np.array(speeds)
    bristle = dahl_bristle(values, np.ones(values.size, dtype=bool), period_s, scale_rad, start())
    assert np.isfinite(bristle).all()
    assert (np.abs(bristle) <= 1.0).all()
