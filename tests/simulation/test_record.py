"""Simulated records: every channel follows from one friction, and the truth is the truth."""

import numpy as np
import pytest
from scipy import stats

from rwa_monitor.errors import InputError
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import VISIBLE_INFORMATION, bearing_temperature, cut, simulate
from rwa_monitor.simulation.scenario import Anomaly, Base, Fault, FrictionNoise, Scenario, Sensors
from rwa_monitor.wheel import torque_balance as tb
from rwa_monitor.wheel.durations import Uniform
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, MEAN_EFFECTS, NOISE_EFFECTS, to_block
from rwa_monitor.wheel.wheel import EffectBlock, Noise, built_in_wheel

WHEEL = built_in_wheel()
kinds = pytest.mark.parametrize("kind", ["orbit", "one_direction", "crossings", "rich", "constant", "from_rest"])
NO_NOISE_OF_SENSORS = Sensors(**dict.fromkeys(Sensors.model_fields, 0.0))  # and no steps
PERFECT = {"sensors": NO_NOISE_OF_SENSORS, "noise": FrictionNoise(std_Nm=0.0)}


def run(seed=0, wheel=WHEEL, **settings):
    """Simulate a record; in every third one friction is not given, unless the test sets otherwise."""
    settings.setdefault("friction_given", seed % 3 != 2)
    return simulate(Scenario(**{"duration_s": 2_500.0, **settings}), wheel, np.random.default_rng(seed))


def derived(record):
    """Return the friction that speed and current of a record give, each as measured."""
    motor = WHEEL.torque_constant_Nm_A * record.samples.motor_current_A
    return tb.derive_friction(record.samples.speed_rad_s, motor, WHEEL)


@kinds
def test_the_friction_is_the_sum_of_its_parts(kind):
    truth = run(speed=SpeedProfile(kind=kind), duration_s=10_000.0).truth
    level = truth.base_dry_Nm + sum(truth.fss_friction_Nm.values())
    friction = np.sign(truth.speed_rad_s) * level + truth.viscous_Nm_s_rad * truth.speed_rad_s
    assert truth.friction_torque_Nm == pytest.approx(friction, abs=1e-15)


@kinds
def test_perfect_speed_and_current_give_the_true_friction_back(kind):
    """Within the error of the derivative: J·|d³ω/dt³|·Δt²·(3h²+3h−1)/30 for a parabola over 2h + 1 slots."""
    record = run(1, speed=SpeedProfile(kind=kind), duration_s=10_000.0, friction_given=False, **PERFECT)
    found = derived(record)
    third = np.max(np.abs(np.diff(record.truth.acceleration_rad_s2, 2))) / WHEEL.sample_period_s**2
    h = tb.half_width(WHEEL.friction.derivative, WHEEL.sample_period_s)
    bound = WHEEL.inertia_kg_m2 * third * WHEEL.sample_period_s**2 * (3 * h * h + 3 * h - 1) / 30 + 1e-12
    assert np.nanmax(np.abs(found - record.truth.friction_torque_Nm)) < bound
    assert np.isfinite(found).sum() == found.size - 2 * h


def test_given_friction_agrees_with_current_sample_by_sample():
    """Noise included: what is measured as friction is what the motor had to give."""
    record = run(sensors=NO_NOISE_OF_SENSORS)
    motor = WHEEL.torque_constant_Nm_A * record.samples.motor_current_A
    found = tb.friction_torque(motor, record.truth.acceleration_rad_s2, WHEEL.inertia_kg_m2)
    assert found == pytest.approx(record.samples.friction_torque_Nm, abs=1e-12)
    noise = record.samples.friction_torque_Nm - record.truth.friction_torque_Nm
    assert noise.std() == pytest.approx(WHEEL.noise.friction_std_Nm, rel=0.03)


def test_voltage_is_that_of_the_winding():
    record = run(sensors=NO_NOISE_OF_SENSORS)
    expected = 2.0 * record.samples.motor_current_A + 0.032 * record.truth.speed_rad_s
    assert record.samples.motor_voltage_V == pytest.approx(expected, abs=1e-12)


def test_power_and_momentum_are_those_of_the_true_constants():
    """J is 4 % larger than the wheel file's and K_T 3 % smaller: what these channels show and the friction hides."""
    inertia, names = WHEEL.inertia_kg_m2, ("motor_current_A", "drive_power_W", "body_momentum_Nms")
    wrong = (
        EffectBlock(name="inertia_error", parameters={"strength_kg_m2": 0.04 * inertia}),
        EffectBlock(name="torque_constant_error", parameters={"strength": 0.03}),
    )
    record = run(sensors=NO_NOISE_OF_SENSORS, effect=wrong, channels=names)
    current, speed = record.samples.motor_current_A, record.truth.speed_rad_s
    assert record.samples.body_momentum_Nms == pytest.approx(-1.04 * inertia * speed, rel=1e-12)
    expected = 3.0 + 2.0 * current**2 + 0.97 * 0.032 * speed * current
    assert record.samples.drive_power_W == pytest.approx(expected, abs=1e-9)


def test_derived_friction_has_the_noise_that_the_truth_states():
    record = run(2, friction_given=False, speed=SpeedProfile(kind="constant", activity=0.0), duration_s=10_000.0)
    assert record.samples.friction_torque_Nm is None
    assert np.nanstd(derived(record) - record.truth.friction_torque_Nm) == pytest.approx(
        record.truth.noise_std_Nm, rel=0.03
    )


def test_each_part_has_randomness_of_its_own():
    """Another noise, a fault, an anomaly, an effect: motion and jumps stay what they were."""
    plain = run(5).truth
    others = (
        run(5, noise=FrictionNoise(law="ar1")),
        run(5, friction_given=False),
        run(5, fault=(Fault(kind="gap", start_s=10, duration_s=5),)),
        run(5, anomalies={"fss_2": Anomaly(factor=1.4), "dry": Anomaly(factor=1.3)}),
        run(5, effect=(EffectBlock(name="torque_bias", parameters={"strength_Nm": 1e-4}),)),
    )
    for other in others:
        assert np.array_equal(other.truth.speed_rad_s, plain.speed_rad_s)
        assert np.array_equal(other.truth.changepoints.index, plain.changepoints.index)


def test_anomalies_scale_their_component_and_are_labelled():
    plain = run(6).truth
    factors = {"dry": 1.3, "viscous": 1.15, "fss_1": 1.6, "fss_2": 1.4}
    for name, factor in factors.items():
        truth = run(6, anomalies={name: Anomaly(factor=factor)}).truth
        assert truth.labels == {other: other == name for other in factors}
        assert truth.factors[name] == factor
        assert truth.base_dry_Nm == pytest.approx(plain.base_dry_Nm * (factor if name == "dry" else 1.0))
        assert truth.viscous_Nm_s_rad == pytest.approx(plain.viscous_Nm_s_rad * (factor if name == "viscous" else 1.0))
        for system, friction in truth.fss_friction_Nm.items():
            times = factor if name == system else 1.0
            assert friction == pytest.approx(times * plain.fss_friction_Nm[system])


def test_growing_anomaly():
    truth = run(base=Base(dry=1.1), anomalies={"dry": Anomaly(factor=1.5, onset_s=500.0, growth_s=1_000.0)}).truth
    at = np.array([0.0, 500.0, 1_000.0, 1_500.0, 2_400.0])
    found = truth.base_dry_Nm[np.rint(at / WHEEL.sample_period_s).astype(int)]
    assert found == pytest.approx(1.6e-3 * 1.1 * np.array([1.0, 1.0, 1.25, 1.5, 1.5]))


def test_changepoints_are_the_jumps_of_the_level():
    for seed in range(5):
        truth = run(seed, duration_s=10_000.0).truth
        level = sum(truth.fss_friction_Nm.values())
        jumps = truth.changepoints
        assert np.flatnonzero(np.diff(level)).tolist() == (np.unique(jumps.index) - 1).tolist()
        alone = np.bincount(jumps.index)[jumps.index] == 1
        assert jumps.jump_Nm[alone] == pytest.approx(np.diff(level)[jumps.index[alone] - 1])
        assert jumps.index.size >= 5
        for number, configuration in enumerate(truth.configuration.values()):
            own = jumps.index[jumps.system == number]
            assert np.flatnonzero(np.diff(configuration)).tolist() == (own - 1).tolist()


def test_visibility_is_the_information_of_an_oracle():
    """λ = (Δ/σ)²·n₁n₂/(n₁+n₂) by hand, with masked slots left out."""
    gap = Fault(kind="gap", start_s=100.0, duration_s=300.0)
    wheel = WHEEL.model_copy(update={"noise": Noise(friction_std_Nm=2e-3)})
    truth = run(7, wheel, duration_s=10_000.0, fault=(gap,)).truth
    jumps = truth.changepoints
    assert not truth.used[800:3200].any()
    edges = np.concatenate([[0], np.unique(jumps.index), [truth.used.size]])
    for k, index in enumerate(jumps.index):
        at = int(np.searchsorted(edges, index))
        before, after = truth.used[edges[at - 1] : index].sum(), truth.used[index : edges[at + 1]].sum()
        expected = (jumps.jump_Nm[k] / 2e-3) ** 2 * before * after / max(before + after, 1)
        assert jumps.information[k] == pytest.approx(expected)
    assert np.array_equal(jumps.visible, jumps.information >= VISIBLE_INFORMATION)
    assert 0 < jumps.visible.sum() < jumps.index.size  # this much noise hides some


def test_two_jumps_on_one_slot_are_not_visible():
    """Both systems jump every slot: no jump is alone."""
    one = Uniform(low=1, high=1)
    systems = tuple(fss.model_copy(update={"durations": (one,) * fss.configurations}) for fss in WHEEL.fss)
    jumps = run(duration_s=10.0, wheel=WHEEL.model_copy(update={"fss": systems})).truth.changepoints
    assert jumps.index.size == 2 * 79
    assert not jumps.visible.any()


def test_faults_are_in_the_table_and_in_the_truth():
    faults = (
        Fault(kind="gap", start_s=100.0, duration_s=10.0),
        Fault(kind="stuck", start_s=500.0, duration_s=20.0, channel="speed_rad_s"),
        Fault(kind="dropout", start_s=0.0, duration_s=2_500.0, channel="friction_torque_Nm", share=0.01),
        Fault(kind="spikes", start_s=0.0, duration_s=2_500.0, channel="motor_current_A", share=0.01, size=0.5),
    )
    clean, record = (run(8, friction_given=True, fault=fault) for fault in ((), faults))
    assert len(record.samples) == len(clean.samples) - 80
    slots = (record.samples.time_ns - record.samples.time_ns[0]) // WHEEL.period_ns
    assert np.array_equal(np.setdiff1d(np.arange(20_000), slots), np.arange(800, 880))
    nan = np.isnan(record.samples.friction_torque_Nm)
    assert 100 < nan.sum() < 300
    assert np.ptp(record.samples.speed_rad_s[(slots >= 4_000) & (slots < 4_160)]) == 0.0
    assert record.truth.faulty[slots[nan]].all()
    spikes = np.abs(record.samples.motor_current_A - clean.samples.motor_current_A[slots])
    assert 100 < np.count_nonzero(spikes) < 300
    assert spikes[spikes > 0.0] == pytest.approx(0.5)
    assert not record.truth.faulty[0]  # slot 0 anchors the grid
    good = ~record.truth.faulty[slots]
    for name, values in record.samples.channels():
        assert np.array_equal(values[good], getattr(clean.samples, name)[slots[good]])


def test_only_the_channels_asked_for():
    channels = ("motor_torque_Nm", "bearing_temperature_degC")
    samples = run(channels=channels, friction_given=False).samples
    assert [name for name, _ in samples.channels()] == ["time_ns", "speed_rad_s", *channels]
    with pytest.raises(InputError, match="channels: friction_torque_Nm is not given"):
        run(channels=("friction_torque_Nm",), friction_given=False)


def test_wheel_without_motor_constants():
    wheel = WHEEL.model_copy(update={"inertia_kg_m2": None})
    assert run(wheel=wheel).samples.motor_current_A is None
    for constant in ("inertia_kg_m2", "torque_constant_Nm_A"):
        with pytest.raises(InputError, match=f"{constant}: is missing"):
            run(wheel=WHEEL.model_copy(update={constant: None}), friction_given=False)


@pytest.mark.parametrize("name", MEAN_EFFECTS)
def test_every_mean_effect_reaches_every_channel(name):
    """y, current and truth hold the same torque; the loop friction → motor torque has settled."""
    effect = MEAN_EFFECTS[name].typical()
    settings = {"speed": SpeedProfile(kind="rich"), **PERFECT}
    plain, record = run(9, **settings), run(9, effect=(to_block(effect),), **settings)
    torque = record.truth.effect_torque_Nm[name]
    assert np.any(torque != 0.0)
    added = record.samples.friction_torque_Nm - plain.samples.friction_torque_Nm
    assert added == pytest.approx(torque, abs=1e-12)
    motor = WHEEL.torque_constant_Nm_A * (record.samples.motor_current_A - plain.samples.motor_current_A)
    assert motor == pytest.approx(torque, abs=1e-12)
    if name in ("load_dependence", "torque_constant_error"):
        strength = effect.values["strength"]
        full = record.truth.motor_torque_Nm
        expected = np.abs(full) * np.sign(record.truth.speed_rad_s) if name == "load_dependence" else full
        assert torque == pytest.approx(strength * expected, abs=1e-12)


def test_effects_of_the_wheel_and_of_the_scenario_add_up():
    bias = EffectBlock(name="torque_bias", parameters={"strength_Nm": 1e-4})
    wheel = WHEEL.model_copy(update={"effect": (bias,)})
    truth = run(wheel=wheel, effect=(bias,)).truth
    assert truth.effect_torque_Nm["torque_bias"] == pytest.approx(2e-4)


def test_a_cut_is_the_record_of_its_slots():
    gap = Fault(kind="gap", start_s=1_000.0, duration_s=10.0)
    record = run(10, duration_s=10_000.0, fault=(gap,))
    piece = cut(record, 4_000, 44_000, WHEEL)
    assert piece.samples.time_ns[0] == 4_000 * WHEEL.period_ns
    assert len(piece.samples) == 40_000 - 80
    jumps = piece.truth.changepoints
    level = sum(piece.truth.fss_friction_Nm.values())
    assert np.array_equal(np.unique(jumps.index) - 1, np.flatnonzero(np.diff(level)))
    assert cut(record, 0, 80_000, WHEEL).samples.time_ns.tobytes() == record.samples.time_ns.tobytes()


def test_extra_system_adds_jumps_of_its_own():
    block = EffectBlock(
        name="extra_switching_system", parameters={"strength_Nm": 4e-4, "rest_s": 200.0, "active_s": 100.0}
    )
    plain, truth = run(11).truth, run(11, effect=(block,)).truth
    assert [*truth.configuration] == ["fss_1", "fss_2", "extra_switching_system"]
    extra = truth.fss_friction_Nm["extra_switching_system"]
    added = truth.friction_torque_Nm - plain.friction_torque_Nm
    assert added == pytest.approx(np.sign(truth.speed_rad_s) * extra, abs=1e-15)
    number = truth.changepoints.index[truth.changepoints.system == 2]
    assert np.array_equal(number - 1, np.flatnonzero(np.diff(extra)))
    assert len(number) >= 4


def test_jumps_relax_and_slopes_jump():
    for name, parameters in (
        ("decaying_jump", {"strength": 0.5, "time_constant_s": 60.0}),
        ("viscous_jump", CATALOGUE["viscous_jump"].typical().values),
    ):
        plain = run(14, duration_s=10_000.0).truth
        truth = run(14, duration_s=10_000.0, effect=(EffectBlock(name=name, parameters=parameters),)).truth
        torque = truth.effect_torque_Nm[name]
        assert np.max(np.abs(torque)) > 1e-4
        assert truth.friction_torque_Nm == pytest.approx(plain.friction_torque_Nm + torque, abs=1e-15)
        assert not torque[: plain.changepoints.index[0]].any()


@pytest.mark.parametrize("friction_given", [True, False])
@pytest.mark.parametrize("name", NOISE_EFFECTS)
def test_noise_effects_shape_the_noise_and_the_truth_knows_its_size(name, friction_given):
    record = run(15, effect=(to_block(NOISE_EFFECTS[name].typical()),), friction_given=friction_given)
    friction = record.samples.friction_torque_Nm if friction_given else derived(record)
    assert np.nanstd(friction - record.truth.friction_torque_Nm) == pytest.approx(record.truth.noise_std_Nm, rel=0.1)


def test_dead_zone_silences_the_tachometer_but_not_the_current():
    block = EffectBlock(name="speed_dead_zone", parameters={"strength_Nm": 1e-3, "dead_zone_rad_s": 5.0})
    settings = {"speed": SpeedProfile(kind="rich"), **PERFECT}
    plain = run(17, friction_given=False, **settings)
    derived = run(17, friction_given=False, effect=(block,), **settings)
    inside = np.abs(derived.truth.speed_rad_s) < 5.0
    assert inside.sum() > 100
    assert np.all(derived.samples.speed_rad_s[inside] == 0.0)
    assert np.array_equal(derived.samples.motor_current_A, plain.samples.motor_current_A)
    given = run(17, friction_given=True, effect=(block,), **settings)
    assert np.all(given.truth.effect_torque_Nm["speed_dead_zone"][~inside] == 0.0)


def test_effects_that_feed_back_too_strongly_are_refused():
    blocks = (
        EffectBlock(name="load_dependence", parameters={"strength": 1.0}),
        EffectBlock(name="torque_constant_error", parameters={"strength": 0.5}),
    )
    with pytest.raises(InputError, match="no torque balances"):
        run(effect=blocks, speed=SpeedProfile(kind="rich"))


# ---- sensors, noise, temperature and faults --------------------------------------------------------------------------


N = 100_000


@pytest.mark.parametrize("law", ["white", "ar1", "student_t"])
def test_every_noise_law_has_the_stated_standard_deviation(law):
    noise = FrictionNoise(law=law, ar_coefficient=0.5, degrees_of_freedom=5)
    drawn = noise.draw(2.0, N, np.random.default_rng(0))
    assert drawn.std() == pytest.approx(2.0, rel=0.03)
    assert abs(drawn.mean()) < 5 * noise.long_run_std(2.0) / np.sqrt(N)
    blocks = drawn.reshape(-1, 500).mean(axis=1)
    assert blocks.std() * np.sqrt(500) == pytest.approx(noise.long_run_std(2.0), rel=0.25)


def test_ar1_has_its_coefficient_and_begins_in_its_stationary_law():
    noise = FrictionNoise(law="ar1", ar_coefficient=0.8)
    drawn = noise.draw(1.0, N, np.random.default_rng(1))
    for lag in (1, 2, 5):
        assert np.corrcoef(drawn[lag:], drawn[:-lag])[0, 1] == pytest.approx(0.8**lag, abs=0.03)
    first = [noise.draw(1.0, 2, np.random.default_rng(seed))[0] for seed in range(3_000)]
    assert stats.kstest(first, "norm").pvalue > 1e-5


def test_temperature_swings_with_the_orbit_and_follows_dissipation_with_a_lag():
    time = np.arange(80_000) * 0.125
    idle = bearing_temperature(time, np.zeros(time.size), np.random.default_rng(4))
    assert 1.0 <= np.ptp(idle) <= 5.0
    assert 10.0 < idle.mean() < 30.0
    power = np.where(time < 5_000.0, 0.0, 1.0)
    warm = bearing_temperature(time, power, np.random.default_rng(4)) - idle
    expected = 2.0 * power.mean() * np.exp(-time / 1200.0)
    expected[time >= 5_000.0] += 2.0 * (1.0 - np.exp(-(time[time >= 5_000.0] - 5_000.0) / 1200.0))
    assert warm == pytest.approx(expected, abs=1e-3)
