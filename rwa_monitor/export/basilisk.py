"""The friction model for Basilisk: fitted parameters of its reaction wheel message, and a module of the exact model.

Basilisk's law of friction, of `reactionWheelStateEffector` (2.12): f_C sign Ω + c Ω, and with β > 0, from rest until
the wheel first slows, √(2e) (f_S − f_C) e^(−(Ω/β)²/2) Ω/(√2 β) + f_C tanh(10 Ω/β) + c Ω. Its parameters are fitted on
the sweep of `c_source.sweep`, whose first quarter is the acceleration from rest.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.export.c_source import SWEEP_S, c_files, render, rms, shared_library, sweep, torque
from rwa_monitor.export.model import FrictionModel
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, Effect, MeanEffect
from rwa_monitor.wheel.effects.drag_laws import ORIGIN_degC

NAMES: Final = ("fCoulomb", "fStatic", "betaStatic", "cViscous")
NO_STRIBECK: Final = -1.0  # of betaStatic: Basilisk's own value for a wheel without Stribeck friction
TRIED_SHARES: Final = (0.003, 0.01, 0.03, 0.1)  # of the largest speed: start values of betaStatic in the fit


class Fit(NamedTuple):
    """Basilisk's parameters by name, and the RMSE [N m] over the sweep."""

    values: dict[str, float]
    rmse_Nm: float


def on_sweep(values: Sequence[float], channels: Channels) -> FloatArray:
    """Return Basilisk's friction over the sweep [N m]: with the law from rest until the wheel first slows."""
    coulomb, static, beta, viscous = values
    speed = channels.speed_rad_s
    plain = coulomb * channels.direction + viscous * speed
    if beta <= 0.0:
        return plain
    ratio = speed / beta
    peak = np.sqrt(np.e) * (static - coulomb) * np.exp(-0.5 * ratio * ratio) * ratio
    return np.where(channels.time_s <= SWEEP_S / 4, peak + coulomb * np.tanh(10.0 * ratio) + viscous * speed, plain)


def fit(model: FrictionModel, effects: Sequence[Effect], top_rad_s: float) -> Fit:
    """Return Basilisk's parameters fitted to the model with some effects, for speeds up to `top_rad_s`."""
    from scipy import optimize  # noqa: PLC0415 - takes long to import, and only this format needs it

    channels = sweep(model, top_rad_s)
    wanted, speed, direction = torque(model, effects, channels), channels.speed_rad_s, channels.direction
    (coulomb, viscous), _ = optimize.nnls(np.column_stack([direction, speed]), wanted)
    found = [[coulomb, coulomb, NO_STRIBECK, viscous]]
    unit = np.array([model.nominal.dry_torque_Nm, model.nominal.dry_torque_Nm, top_rad_s, 0.0])
    unit[3] = unit[0] / top_rad_s  # scales all four parameters to near one

    def values_of(x: FloatArray) -> list[float]:
        coulomb, more, beta, viscous = (x * unit).tolist()
        return [coulomb, coulomb + more, beta, viscous]  # static never below Coulomb

    def residual(x: FloatArray) -> FloatArray:
        return np.asarray((on_sweep(values_of(x), channels) - wanted) / unit[0])

    for share in TRIED_SHARES:
        start = [coulomb / unit[0], 0.1, share, viscous / unit[3]]
        x = optimize.least_squares(residual, start, bounds=([0.0, 0.0, 1e-4, 0.0], np.inf), x_scale=[1, 1, share, 1]).x
        found.append(values_of(x))
    rmse = [rms(on_sweep(values, channels) - wanted) for values in found]
    best = int(np.argmin(rmse))
    return Fit(dict(zip(NAMES, map(float, found[best]), strict=True)), rmse[best])


def basilisk_files(model: FrictionModel) -> dict[str, bytes]:
    """Return the Python module, the library that it loads, and the library's sources; errors as for `fmu_files`."""
    top = model.nominal.nominal_speed_rad_s
    sources = c_files(model)
    module = render(
        "rwa_friction_basilisk.py",
        model,
        fit=fit(model, [part.effect for part in model.parts], top),
        alone=[
            (part.effect.name, fit(model, [part.effect], top).rmse_Nm)
            for part in model.parts
            if isinstance(part.effect, MeanEffect)  # the others depend on jumps
        ],
        top=top,
        sweep_s=SWEEP_S,
        temperature=ORIGIN_degC,
    )
    return {
        "rwa_friction_basilisk.py": module,
        "librwa_friction.so": shared_library(sources, "--to basilisk", hidden=False),
        **sources,
    }
