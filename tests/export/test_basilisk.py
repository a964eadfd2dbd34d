"""What is exported for Basilisk, without Basilisk: `make outside` runs it there (benchmarks/basilisk/exported.py)."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rwa_monitor.export.basilisk import NO_STRIBECK, fit, on_sweep
from rwa_monitor.export.c_source import rms, sweep
from rwa_monitor.export.model import friction_model
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, build, to_block
from rwa_monitor.wheel.wheel import EffectBlock, Wheel
from tests.export.script import largest_difference, simulated, wheel_with
from tests.program import run

TOP_RAD_S = 300.0


def block(name: str, **changes: float) -> EffectBlock:
    return to_block(CATALOGUE[name].typical(**changes))


def load(wheel: Wheel, folder: Path) -> SimpleNamespace:
    """Export the wheel, and run the module that was written."""
    (folder / "wheel.toml").write_text(wheel.to_toml(), encoding="utf-8")
    assert run("export", folder / "wheel.toml", "--to", "basilisk", "-o", folder).exit_code == 0
    return SimpleNamespace(**runpy.run_path(str(folder / "rwa_friction_basilisk.py")))


def test_the_module_is_the_exact_model(tmp_path: Path) -> None:
    wheel = wheel_with(block("lubricant_lag"), block("presliding"), block("decaying_jump"), block("coloured_noise"))
    module, script = load(wheel, tmp_path), simulated(wheel)
    friction = module.Friction()
    for _ in range(2):
        friction.reset()
        torque = []
        for *motion, level in script.inputs[:30_000].tolist():
            friction.state.dry_level_Nm = level
            torque.append(friction.torque(*motion, script.period_s))
        assert largest_difference(np.array(torque), script.torque_Nm[:30_000]) < 1e-9
    assert [name for name, _ in module.COSTS_NM] == ["lubricant_lag", "presliding"]
    assert set(module.MESSAGE) == {"fCoulomb", "fStatic", "betaStatic", "cViscous"}


def test_a_wheel_of_basilisks_own_law_is_fitted_exactly() -> None:
    model = friction_model(wheel_with(), "")
    found = fit(model, [], TOP_RAD_S)
    assert found.rmse_Nm < 1e-12
    assert found.values["fCoulomb"] == pytest.approx(model.nominal.dry_torque_Nm, rel=1e-6)
    assert found.values["cViscous"] == pytest.approx(model.nominal.viscous_Nm_s_rad, rel=1e-6)


def test_the_law_has_its_peak_at_beta_and_both_branches_are_on_the_sweep() -> None:
    channels = sweep(friction_model(wheel_with(), ""), TOP_RAD_S)
    peak = on_sweep((0.0, 1.0, channels.speed_rad_s[133], 0.0), channels)
    assert (np.argmax(peak), np.max(peak)) == (133, pytest.approx(1.0))
    plain = on_sweep((1e-3, 2e-3, NO_STRIBECK, 1e-6), channels)
    rising = on_sweep((1e-3, 2e-3, 8.0, 1e-6), channels)
    assert np.array_equal(plain[channels.time_s > 500.0], rising[channels.time_s > 500.0])
    assert np.max(rising - plain) > 0.9e-3


def test_what_an_effect_costs_is_what_the_law_cannot_hold() -> None:
    model = friction_model(wheel_with(), "")
    channels = sweep(model, TOP_RAD_S)

    def held(name: str, **changes: float) -> tuple[float, float]:
        effect = build(block(name, **changes))
        return fit(model, [effect], TOP_RAD_S).rmse_Nm, rms(effect.torque(channels)[0])

    for name in ("inertia_error", "torque_bias", "quadratic_drag", "viscosity_temperature"):
        left, whole = held(name)
        assert 0.02 * whole < left <= whole, name  # a part may pass for dry and viscous friction
    # A Stribeck peak is held on the way up from rest, where Basilisk has one; beyond, it is not.
    left, whole = held("stribeck", stribeck_speed_rad_s=20.0)
    assert left < 0.95 * whole
