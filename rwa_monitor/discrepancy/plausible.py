"""What a table of samples must agree with before it is made a record: the wheel's limits, friction and voltage."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.errors import InputError
from rwa_monitor.physics.wheel import Wheel
from rwa_monitor.samples import Samples

# Of nominal friction: mN m read as N m are a thousand; no bearing gets there and turns.
WRONG_UNIT_FACTOR: Final = 100.0
UNUSUAL_FACTOR: Final = 5.0  # of nominal friction: a wheel that has gone bad, or another wheel


def check_plausible(samples: Samples, wheel: Wheel, source: str) -> None:
    """Refuse tables in wrong units: values beyond the wheel's limits, or a voltage that contradicts the speed."""
    if len(samples) == 0:
        raise InputError(source, "holds no samples")
    limits = wheel.limits
    for name, limit in (("speed_rad_s", limits.max_speed_rad_s), ("motor_current_A", limits.max_current_A)):
        values = getattr(samples, name)
        if values is None or limit is None or not np.isfinite(values).any():
            continue
        largest = float(np.nanmax(np.abs(values)))
        if largest > limit:
            raise InputError(source, f"reaches {largest:.6g}, the wheel's limit is {limit:.6g}; wrong unit?", name)
    ratio = friction_over_nominal(samples, wheel)
    if ratio is not None and not 1 / WRONG_UNIT_FACTOR < ratio < WRONG_UNIT_FACTOR:
        raise InputError(
            source,
            f"is {ratio:.3g} times the wheel's nominal friction on the median; wrong unit?",
            "friction_torque_Nm",
        )
    known = (wheel.winding_resistance_ohm, wheel.back_emf_constant_V_s_rad)
    voltage, current = samples.motor_voltage_V, samples.motor_current_A
    if voltage is not None and current is not None and None not in known:
        resistance, back_emf = float(known[0] or 0), float(known[1] or 0)
        expected = resistance * current + back_emf * (wheel.gear_ratio or 1.0) * samples.speed_rad_s
        both = np.isfinite(expected) & np.isfinite(voltage)
        scale = float(np.sqrt(np.mean(expected[both] ** 2))) if both.any() else 0.0
        # Half of the signal: a sensor may be off by per cents, a unit is off by factors.
        if scale > 0 and float(np.sqrt(np.mean((voltage - expected)[both] ** 2))) > 0.5 * scale:
            raise InputError(
                source,
                "contradicts R·I + K_E·ω of the wheel file by more than half; is a unit or a constant wrong?",
                "motor_voltage_V",
            )


def friction_over_nominal(samples: Samples, wheel: Wheel) -> float | None:
    """Return the median of friction as measured over nominal friction at that speed [-]; None where one is not known.

    Samples near rest, at a tenth of the median speed or less, do not count: there friction has no sign.
    """
    if wheel.nominal is None or samples.friction_torque_Nm is None:
        return None
    speed = np.abs(samples.speed_rad_s)
    known = np.isfinite(speed) & np.isfinite(samples.friction_torque_Nm)
    if not known.any():
        return None
    moving = known & (speed > 0.1 * float(np.median(speed[known])))
    if not moving.any():
        return None
    nominal = wheel.nominal.dry_torque_Nm + wheel.nominal.viscous_Nm_s_rad * speed[moving]
    return float(np.median(np.abs(samples.friction_torque_Nm[moving]) / nominal))


def unusual(samples: Samples, wheel: Wheel) -> str | None:
    """Say in words what is unusual about a table that is not refused; None where nothing is."""
    ratio = friction_over_nominal(samples, wheel)
    if (
        ratio is None
        or 1 / UNUSUAL_FACTOR < ratio < UNUSUAL_FACTOR
        or not 1 / WRONG_UNIT_FACTOR < ratio < WRONG_UNIT_FACTOR
    ):
        return None
    return f"friction is {ratio:.2g} times the wheel's nominal friction on the median; is it the right wheel file?"
