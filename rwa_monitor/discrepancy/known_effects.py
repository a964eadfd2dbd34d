"""Effects that the wheel file has already: taken out of the records before anything is searched or learned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rwa_monitor.discrepancy.alignment import Delay
from rwa_monitor.discrepancy.quantisation import without_steps
from rwa_monitor.discrepancy.record import Record, make_record
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.effects.catalogue import effect_torque, mean_effects
from rwa_monitor.wheel.effects.current_delay import CurrentDelay
from rwa_monitor.wheel.wheel import Wheel


def records_of(recordings: Sequence[tuple[str, Samples]], wheel: Wheel, delay: Delay | None = None) -> list[Record]:
    """Make the records of a wheel, without what the effects in its file explain and without a delay of the current."""
    if delay is not None:  # taken out of the torque itself: to first order it would be taken out a second time
        wheel = wheel.model_copy(update={"effect": tuple(b for b in wheel.effect if b.name != CurrentDelay.name)})
    records = [make_record(samples, wheel, name, delay) for name, samples in recordings]
    return without_steps([without_known_effects(record, wheel) for record in records], wheel)


def known_delay(wheel: Wheel) -> Delay | None:
    """Return the delay of the current of the wheel's file, in whole slots; None where it is within a slot."""
    seconds = sum(block.parameters["strength_s"] for block in wheel.effect if block.name == CurrentDelay.name)
    slots = -round(seconds / wheel.sample_period_s)
    return Delay(slots, 0.0, 0.0, 0.0) if slots else None


def without_known_effects(record: Record, wheel: Wheel) -> Record:
    """Subtract the torque of the effects that the wheel already has."""
    effects = mean_effects(wheel)
    if not effects:
        return record
    viscous = wheel.nominal.viscous_Nm_s_rad if wheel.nominal else 0.0
    torque, _ = effect_torque(effects, record.channels, record.friction_torque_Nm, viscous, [None] * len(effects))
    return replace(record, friction_torque_Nm=record.friction_torque_Nm - np.nan_to_num(torque))
