"""Viscous friction judged at the bearing's temperature; a channel that is broken makes no false alarm."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.messages import Diagnosis
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.samples import FloatArray, Samples
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Anomaly, Base, Scenario, Temperature
from rwa_monitor.wheel.wheel import EffectBlock, Nominal, TemperatureRange, Wheel, built_in_wheel

COLD_DEGC, WARM_DEGC = 8.0, 33.0
LAG_S = 600.0


def wheel(lag_s: float = LAG_S) -> Wheel:
    """Return the built-in wheel with viscosity that falls by 5 % a kelvin, learned from 3 to 37 °C."""
    built_in = built_in_wheel()
    law = {
        "strength_Nm_s_rad": built_in.nominal.viscous_Nm_s_rad,
        "activation_temperature_K": 4300.0,
        "sensor_lag_s": lag_s,
    }
    block = EffectBlock(name="viscosity_temperature", parameters=law)
    known = TemperatureRange(low_degC=3.0, high_degC=37.0)
    return built_in.model_copy(update={"effect": (block,), "temperature": known})


@cache
def record(mean_degC: float, seed: int = 7, factor: float = 1.0, swing_K: float = 3.0) -> Samples:
    """Return a window of the wheel, of which viscous friction is too large by a factor."""
    anomalies = {"viscous": Anomaly(factor=factor)} if factor != 1.0 else {}
    scenario = Scenario(temperature=Temperature(mean_degC=mean_degC, swing_K=swing_K), anomalies=anomalies)
    return simulate(scenario, wheel(), np.random.default_rng(seed)).samples


def still(at_degC: float, factor: float = 1.0) -> Samples:
    """Return a window at one temperature: a wheel of which viscous friction is another, whatever it is for."""
    share = float(np.exp(4300.0 * (1.0 / (at_degC + 273.15) - 1.0 / 293.15)))
    scenario = Scenario(base=Base(viscous=share * factor))
    return simulate(scenario, built_in_wheel(), np.random.default_rng(7)).samples


def diagnosed(samples: Samples, of_wheel: Wheel | None = None) -> Diagnosis:
    """Diagnose one window."""
    (closed,) = diagnose_samples(samples, of_wheel or wheel(), built_in_model())
    return closed.diagnosis


def with_temperature(samples: Samples, temperature: FloatArray | None) -> Samples:
    """Return samples with another temperature channel."""
    return replace(samples, bearing_temperature_degC=temperature)


@pytest.mark.parametrize("mean_degC", [COLD_DEGC, 20.0, WARM_DEGC])
@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "nominal"), (1.15, "anomalous")])
def test_warm_and_cold_are_judged_alike(mean_degC: float, factor: float, verdict: str) -> None:
    diagnosis = diagnosed(record(mean_degC, factor=factor))
    assert diagnosis.verdict == verdict
    assert diagnosis.model_adequate
    nominal = built_in_wheel().nominal.viscous_Nm_s_rad
    assert diagnosis.friction.viscous.value == pytest.approx(factor * nominal, rel=3e-3)
    assert [name for name, one in diagnosis.anomalies.items() if one.active] == (["viscous"] if factor > 1.0 else [])


@pytest.mark.parametrize("mean_degC", [-5.0, 45.0])
@pytest.mark.parametrize("factor", [1.0, 1.3])
def test_beyond_what_was_learned_viscous_friction_is_not_judged_and_the_rest_is(
    mean_degC: float, factor: float
) -> None:
    diagnosis = diagnosed(record(mean_degC, factor=factor))
    assert diagnosis.verdict == "inconclusive"
    assert "viscous friction was learned from 3 °C to 37 °C" in diagnosis.reason
    assert diagnosis.anomalies["dry"].probability < 0.1


def broken(samples: Samples, how: str) -> Samples:
    """Return samples whose temperature channel is broken, or coarse."""
    temperature = np.array(samples.bearing_temperature_degC)
    if how == "missing for a minute":
        temperature[30_000:30_480] = np.nan
    elif how == "missing for 20 minutes":
        temperature[30_000:39_600] = np.nan
    elif how == "coarse":
        temperature = 0.5 * np.rint(2.0 * temperature)
    elif how == "stuck":
        temperature[26_000:] = temperature[26_000]
    elif how == "stuck from before":
        temperature[:] = 20.0
    elif how == "missing":
        return with_temperature(samples, None)
    return with_temperature(samples, temperature)


@pytest.mark.parametrize("mean_degC", [COLD_DEGC, WARM_DEGC])
@pytest.mark.parametrize("how", ["missing for a minute", "missing for 20 minutes", "coarse"])
def test_short_gaps_and_coarse_digits_change_no_verdict(mean_degC: float, how: str) -> None:
    assert diagnosed(broken(record(mean_degC), how)).verdict == "nominal"
    failing = diagnosed(broken(record(mean_degC, factor=1.3), how))
    assert failing.verdict == "anomalous"
    assert failing.anomalies["viscous"].active


@pytest.mark.parametrize("seed", [7, 8, 9])
@pytest.mark.parametrize("mean_degC", [COLD_DEGC, WARM_DEGC])
@pytest.mark.parametrize("how", ["stuck", "stuck from before", "missing"])
def test_a_channel_that_is_stuck_or_missing_makes_no_alarm(how: str, mean_degC: float, seed: int) -> None:
    diagnosis = diagnosed(broken(record(mean_degC, seed), how))
    assert diagnosis.verdict != "anomalous"
    assert not any(one.active and one.probability >= 0.6 for one in diagnosis.anomalies.values())


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("stuck", "temperature is missing, or stuck, for 64 % of the window"),
        ("stuck from before", "temperature stands still at 20 °C while friction does not"),
        ("missing", "temperature is missing, or stuck, for 100 % of the window"),
    ],
)
def test_the_reason_names_the_temperature(how: str, reason: str) -> None:
    assert reason in diagnosed(broken(record(20.0), how)).reason


@pytest.mark.parametrize("seed", [7, 8, 9])
@pytest.mark.parametrize("mean_degC", [COLD_DEGC, WARM_DEGC])
def test_a_lag_that_the_wheel_file_lacks_makes_no_alarm(mean_degC: float, seed: int) -> None:
    assert diagnosed(record(mean_degC, seed), wheel(lag_s=0.0)).verdict != "anomalous"


def test_a_wheel_that_is_judged_by_its_spread_is_nominal_within_it_and_the_verdict_states_what_is_missing() -> None:
    built_in = built_in_wheel()
    nominal = Nominal(**{**built_in.nominal.model_dump(), "viscous_spread": 0.15})
    blind = built_in.model_copy(update={"nominal": nominal})
    for mean_degC in (18.0, 22.0):  # 10 % off the nominal value, and nothing that warms or cools it
        samples = with_temperature(still(mean_degC), None)
        assert diagnosed(samples, built_in).verdict != "nominal"
        diagnosis = diagnosed(samples, blind)
        assert diagnosis.verdict == "nominal"
        assert "with the bearing's temperature recorded" in diagnosis.explanation
    far = diagnosed(with_temperature(still(20.0, factor=2.0), None), blind)
    assert far.verdict == "anomalous"
    assert far.anomalies["viscous"].active
