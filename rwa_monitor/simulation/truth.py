"""The truth about a simulated record: components, jumps, and which of the jumps can be seen at all."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np

from rwa_monitor.samples import BoolArray, FloatArray, IntArray, Samples
from rwa_monitor.wheel.switching_systems import Realisation
from rwa_monitor.wheel.wheel import Wheel

# A jump counts as visible when an oracle, given its place, its neighbours and the slope, sees it at six standard
# deviations: λ = (Δ/σ)²·n₁n₂/(n₁+n₂) ≥ 6². A search over 80,000 slots and seven scales (5.6e5 contrasts) that promises
# at most 0.01 false ones a window needs a threshold of 5.6 σ; below six, no method that keeps the promise can be
# expected to find the jump.
VISIBLE_INFORMATION: Final = 36.0


@dataclass(frozen=True, slots=True)
class Changepoints:
    """The true jumps of all switching systems, sorted by slot; arrays (m,).

    Attributes
    ----------
    index
        int64, first slot of the new level.
    system
        int64, number of the switching system in the wheel file.
    jump_Nm
        Change of dry friction [N m], positive upwards.
    information
        λ = (Δ/σ)²·n₁n₂/(n₁+n₂), n the used samples up to the neighbouring true jumps: the squared signal-to-noise
        ratio of an oracle's contrast.
    visible
        bool, λ ≥ 36 and no other jump on the same slot.
    """

    index: IntArray
    system: IntArray
    jump_Nm: FloatArray
    information: FloatArray
    visible: BoolArray

    def __len__(self) -> int:
        """Count the jumps."""
        return int(self.index.size)


@dataclass(frozen=True, slots=True)
class Truth:
    """All that is true of a record of n slots. Slots, not rows: a gap removes rows of the table only.

    Attributes
    ----------
    speed_rad_s, acceleration_rad_s2, bearing_temperature_degC
        float64 (n,), true motion and temperature.
    friction_torque_Nm
        float64 (n,), true friction without noise, effects included.
    noise_Nm
        float64 (n,), noise of the friction torque.
    motor_torque_Nm
        float64 (n,) what the motor gives, noise included; None for a wheel without inertia.
    base_dry_Nm, viscous_Nm_s_rad
        float64 (n,), base dry friction (all systems at rest) and viscous coefficient, anomalies included.
    configuration, fss_friction_Nm
        By system name: int64 (n,) and float64 (n,) [N m].
    effect_torque_Nm
        By effect name, in the order of application: float64 (n,) [N m].
    used
        bool (n,), slots in the table, without fault, |ω| outside the dead band.
    faulty
        bool (n,), slots hit by a declared fault.
    changepoints
        See its class.
    noise_std_Nm, long_run_std_Nm
        Standard deviation of a single friction value, and of a long mean times the root of its length [N m].
    labels
        By anomaly name: whether it is active at the end of the record.
    factors
        By anomaly name: its factor at the end of the record.
    """

    speed_rad_s: FloatArray
    acceleration_rad_s2: FloatArray
    bearing_temperature_degC: FloatArray
    friction_torque_Nm: FloatArray
    noise_Nm: FloatArray
    motor_torque_Nm: FloatArray | None
    base_dry_Nm: FloatArray
    viscous_Nm_s_rad: FloatArray
    configuration: dict[str, IntArray]
    fss_friction_Nm: dict[str, FloatArray]
    effect_torque_Nm: dict[str, FloatArray]
    used: BoolArray
    faulty: BoolArray
    changepoints: Changepoints
    noise_std_Nm: float
    long_run_std_Nm: float
    labels: dict[str, bool]
    factors: dict[str, float]


@dataclass(frozen=True, slots=True)
class Telemetry:
    """A simulated record: what the monitor gets, and what is true."""

    samples: Samples
    truth: Truth


def true_changepoints(
    systems: list[Realisation], used: BoolArray, torque_unit_Nm: float, long_run_std_Nm: float
) -> Changepoints:
    """Collect the jumps of all systems and report which of them can be seen."""
    index = np.concatenate([np.zeros(0, dtype=np.int64), *(system.jump_index for system in systems)])
    number = np.concatenate(
        [np.zeros(0, dtype=np.int64), *(np.full(s.jump_index.size, k, dtype=np.int64) for k, s in enumerate(systems))]
    )
    jump = np.concatenate([np.zeros(0), *(torque_unit_Nm * system.jump for system in systems)])
    order = np.lexsort((number, index))
    index, number, jump = index[order], number[order], jump[order]
    return with_information(index, number, jump, used, long_run_std_Nm)


def with_information(
    index: IntArray, system: IntArray, jump_Nm: FloatArray, used: BoolArray, long_run_std_Nm: float
) -> Changepoints:
    """Return the jumps, sorted by slot, with what an oracle sees of each; `used` has the length of the record."""
    real = jump_Nm != 0.0
    places, times = np.unique(index[real], return_counts=True)
    used_before = np.concatenate([[0], np.cumsum(used)])
    between = np.diff(used_before[np.concatenate([[0], places, [used.size]])]).astype(np.float64)
    left, right = between[:-1], between[1:]
    samples = np.divide(left * right, left + right, out=np.zeros(places.size), where=left * right > 0.0)

    at = np.searchsorted(places, index[real])
    information = np.zeros(index.size)
    with np.errstate(divide="ignore", invalid="ignore"):  # without noise, every jump with a sample on each side shows
        ratio = np.square(jump_Nm[real] / long_run_std_Nm)
        information[real] = np.where(samples[at] > 0.0, samples[at] * ratio, 0.0)
    alone = np.zeros(index.size, dtype=np.bool_)
    alone[real] = times[at] == 1
    return Changepoints(index, system, jump_Nm, information, alone & (information >= VISIBLE_INFORMATION))


def cut(telemetry: Telemetry, start: int, stop: int, wheel: Wheel) -> Telemetry:
    """Return the slots [start, stop) of a record as a record of its own, with what can be seen of its jumps there.

    Labels and factors are kept as they are: the caller decides what the piece is meant to show.
    """
    truth = telemetry.truth
    piece: dict[str, Any] = {}
    for field in fields(Truth):
        value = getattr(truth, field.name)
        if isinstance(value, np.ndarray):
            piece[field.name] = value[start:stop]
        elif isinstance(value, dict) and field.name not in ("labels", "factors"):
            piece[field.name] = {name: array[start:stop] for name, array in value.items()}
        else:
            piece[field.name] = value
    jumps = truth.changepoints
    inside = (jumps.index > start) & (jumps.index < stop)
    piece["changepoints"] = with_information(
        jumps.index[inside] - start,
        jumps.system[inside],
        jumps.jump_Nm[inside],
        truth.used[start:stop],
        truth.long_run_std_Nm,
    )
    origin = int(telemetry.samples.time_ns[0])
    first, last = origin + start * wheel.period_ns, origin + stop * wheel.period_ns
    rows = slice(*np.searchsorted(telemetry.samples.time_ns, [first, last]))
    return Telemetry(telemetry.samples[rows], Truth(**piece))
