"""The extended wheel is the model that was fitted, whichever way the wheel's file came about."""

import numpy as np
import pytest

from rwa_monitor.discrepancy.base_fit import remove_levels, segment_starts
from rwa_monitor.discrepancy.extended import extend, laws_in_words
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.identification.identify import identify
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Anomaly, Scenario
from rwa_monitor.wheel.effects.catalogue import mean_effects
from rwa_monitor.wheel.wheel import EffectBlock, Wheel, built_in_wheel

VISCOUS = built_in_wheel().nominal.viscous_Nm_s_rad
CONCAVE = EffectBlock(name="sublinear_viscous", parameters={"strength_Nm": 2.0e-5, "exponent": 0.667})


def record(seed: int, **anomalies: float) -> Samples:
    """Simulate 1500 s of rich motion with a concave drag, and with anomalies."""
    factors = {name: Anomaly(factor=factor) for name, factor in anomalies.items()}
    scenario = Scenario(duration_s=1500.0, speed=SpeedProfile(kind="rich"), effect=(CONCAVE,), anomalies=factors)
    return simulate(scenario, built_in_wheel(), np.random.default_rng(seed)).samples


def searched(samples: Samples, wheel: Wheel) -> Search:
    search = find_discrepancy([("record", samples)], wheel)
    assert search.extended.names == ("sublinear_viscous",)
    return search


def left_by(search: Search, wheel: Wheel) -> float:
    """Return the RMS of friction less viscous friction and effects of a wheel, levels free: written a second time."""
    channels = search.problem.records[0].channels
    law = wheel.nominal.viscous_Nm_s_rad * channels.speed_rad_s
    for effect in mean_effects(wheel):
        law = law + effect.torque(channels)[0]
    rest = search.problem.z - (np.sign(channels.speed_rad_s) * law)[search.problem.records[0].used]
    inner = remove_levels(rest, segment_starts(search.problem, search.extended.fit.jumps))
    return float(np.sqrt(np.mean(inner**2)))


@pytest.mark.parametrize("factor", [pytest.param(1.0, marks=pytest.mark.slow), 1.4])
def test_a_file_that_holds_the_wheel_without_the_effect_is_kept_and_takes_up_no_anomaly(factor: float) -> None:
    search = searched(record(11, viscous=factor), built_in_wheel())
    extension = extend(search, report_sha256="0f" * 32)
    assert search.base.fit.coefficients[0] > 0  # then no effect is propped up by a negative viscosity
    assert search.problem.lowest_viscous == 0
    assert extension.treatment == "kept"
    assert extension.wheel.nominal == built_in_wheel().nominal
    assert abs(extension.after.viscous_Nm_s_rad - factor * VISCOUS) < 4 * extension.after.viscous_std
    assert extension.to_toml().startswith("# In [nominal]")
    assert Wheel.from_toml(extension.to_toml(), "extended") == extension.wheel
    (block,), (found,) = extension.wheel.effect, search.result.effects
    assert block.report_sha256 == "0f" * 32
    assert block.std["strength_Nm"] == pytest.approx(found.parameters["strength_Nm"].std, rel=1e-9)
    assert block.parameters["strength_Nm"] == pytest.approx(found.parameters["strength_Nm"].value, rel=1e-9)


def test_a_file_learned_with_the_effect_in_it_gives_back_what_the_effect_takes_over() -> None:
    learned = identify([("first", record(16))], built_in_wheel(), systems=False).wheel
    assert learned.nominal.viscous_Nm_s_rad > 1.2 * VISCOUS  # the slope of the concave drag is in it
    search = searched(record(17), learned)
    extension = extend(search)
    assert extension.treatment == "shifted"
    assert abs(extension.wheel.nominal.viscous_Nm_s_rad - VISCOUS) < 0.4 * (learned.nominal.viscous_Nm_s_rad - VISCOUS)
    # Simulated on the record's own speed it leaves hardly more than noise; the file as it was leaves more.
    gain = search.result.gain
    assert extension.simulated.rmse_extended_Nm == pytest.approx(left_by(search, extension.wheel), rel=1e-9)
    assert extension.simulated.rmse_extended_Nm < 1.05 * gain.rmse_extended_Nm
    assert extension.simulated.rmse_base_Nm > extension.simulated.rmse_extended_Nm
    assert any("learned with the effects in them" in line for line in laws_in_words(extension))


def test_a_slope_that_the_effect_takes_over_whole_leaves_a_unit_to_judge_friction_by() -> None:
    # Viscous friction all but absent: the slope of the file is that of the concave drag, and nothing is left of it.
    bare = built_in_wheel()
    bare = bare.model_copy(update={"nominal": bare.nominal.model_copy(update={"viscous_Nm_s_rad": 1e-9})})
    scenario = Scenario(duration_s=1500.0, speed=SpeedProfile(kind="rich"), effect=(CONCAVE,))
    samples = simulate(scenario, bare, np.random.default_rng(15)).samples
    learned = identify([("first", samples)], bare, systems=False).wheel
    extension = extend(searched(samples, learned))
    assert extension.treatment == "shifted"
    assert 0 < extension.wheel.nominal.viscous_Nm_s_rad < 0.5 * learned.nominal.viscous_Nm_s_rad
