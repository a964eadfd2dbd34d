"""The friction model of a wheel as other simulators take it: its constants, its law in C, and what it does not hold.

The torque is that of the simulation: dry level and viscous friction, then what the effects of the wheel file add. It is
what resists in J·dω/dt = K_T·I − torque with J and K_T of the wheel file, so effects of a wrong J or K_T are held too.
Those that follow the motor torque take J·dω/dt plus the whole friction for it, and the loop is solved as the simulation
solves it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple, cast

import numpy as np

from rwa_monitor.errors import InputError
from rwa_monitor.export.recording import Recorded, Recorder, literal
from rwa_monitor.version import SOFTWARE
from rwa_monitor.wheel.effects.base import Channels, Effect, MeanEffect
from rwa_monitor.wheel.effects.catalogue import build
from rwa_monitor.wheel.effects.formula import Formula
from rwa_monitor.wheel.effects.switching_base import Jumps, SwitchingEffect
from rwa_monitor.wheel.wheel import EffectBlock, Nominal, Wheel

INPUTS: Final = {
    "speed_rad_s": "rad/s",
    "acceleration_rad_s2": "rad/s2",
    "angle_rad": "rad",
    "temperature_degC": "degC",
}
MOTOR: Final = "motor_torque_Nm"


class _RecordedJumps:
    """`Jumps` of the dry level as the state of the C function holds them."""

    def __init__(self, recorder: Recorder) -> None:
        self._channel = recorder.channel

    def total(self, _: int) -> Recorded:
        return self._channel("(level_Nm - state->first_level_Nm)")

    def last(self, _: int) -> Recorded:
        return self._channel("state->jump_Nm")

    def since_s(self, _: int, _period_s: float) -> Recorded:
        return self._channel("(state->time_s - state->jump_time_s)")


class Part(NamedTuple):
    """One effect of the model.

    Attributes
    ----------
    effect, block
        As built, and as the wheel file has it.
    statements, torque
        In C: what comes before, and the torque [N m]; none where the model does not hold the effect.
    """

    effect: Effect
    block: EffectBlock
    statements: tuple[str, ...] = ()
    torque: str = ""

    @property
    def coupled(self) -> bool:
        """Whether it follows the motor torque."""
        return MOTOR in self.torque or any(MOTOR in line for line in self.statements)

    @property
    def title(self) -> str:
        """Its name; of a formula, its law, too."""
        return f"{self.effect.name}: {self.effect.text}" if isinstance(self.effect, Formula) else self.effect.name

    def constants(self) -> list[dict[str, Any]]:
        """Return name, value, standard deviation (None where it is not known) and unit of each parameter."""
        units = {parameter.name: parameter.unit for parameter in self.effect.parameters}
        std = self.block.std or {}
        return [
            {"name": name, "value": value, "std": std.get(name), "unit": units[name]}
            for name, value in self.effect.values.items()
        ]


class FrictionModel(NamedTuple):
    """A wheel's friction.

    Attributes
    ----------
    wheel, nominal
        Whose it is; its nominal friction.
    parts, left_out
        The effects that the model holds, in the order in which their torques are added, and those that it does not.
    memory
        Start values of the recursions.
    """

    wheel: Wheel
    nominal: Nominal
    parts: tuple[Part, ...]
    left_out: tuple[Part, ...]
    memory: tuple[float, ...]

    @property
    def reports(self) -> list[str]:
        """The SHA-256 of the discrepancy reports that the effects come from, each once."""
        return list(dict.fromkeys(block.report_sha256 for block in self.wheel.effect if block.report_sha256))

    def uses(self, name: str) -> bool:
        """Return whether an effect's C has a variable or a function of that name."""
        return any(name in line for part in self.parts for line in (*part.statements, part.torque))


def friction_model(wheel: Wheel, source: str) -> FrictionModel:
    """Write down the friction model of a wheel.

    Parameters
    ----------
    wheel, source
        The wheel, and the name of its file for messages.

    Raises
    ------
    InputError
        If the wheel has no nominal friction, or no inertia where an effect follows the motor torque; or if an effect of
        another package computes what has no counterpart in C.
    """
    if wheel.nominal is None:
        raise InputError(source, "is missing; identify learns it from recordings", "nominal")
    recorder, parts = Recorder(), [Part(build(block), block) for block in wheel.effect]
    held = [_recorded(part, wheel, recorder, source) for part in parts if not part.effect.not_exported]
    order = sorted(held, key=lambda part: not isinstance(part.effect, SwitchingEffect))  # as they are simulated
    left_out = tuple(part for part in parts if part.effect.not_exported)
    return FrictionModel(wheel, wheel.nominal, tuple(order), left_out, tuple(recorder.memory))


def _recorded(part: Part, wheel: Wheel, recorder: Recorder, source: str) -> Part:
    """Return a part with its torque in C."""
    effect = part.effect
    if MOTOR in getattr(effect, "needs", ()) and wheel.inertia_kg_m2 is None:
        raise InputError(source, f"is missing; {effect.name} follows the motor torque", "inertia_kg_m2")
    channels = _recorded_channels(recorder, wheel.sample_period_s)
    torque: Any
    try:
        if isinstance(effect, SwitchingEffect):
            torque = effect.torque(channels, cast("Jumps", _RecordedJumps(recorder)))
        else:
            torque = cast("MeanEffect", effect).torque(channels)[0]
    except InputError as error:
        raise InputError(f"{source}: effect {effect.name}", error.reason) from error
    (cell,) = torque.cells if isinstance(torque, Recorded) else torque.tolist()
    return Part(effect, part.block, recorder.take(), literal(cell))


def _recorded_channels(recorder: Recorder, period_s: float) -> Channels:
    """Return channels of one slot, which are the variables of the C function."""
    channel: Any = recorder.channel
    return Channels(
        time_s=channel("state->time_s"),
        speed_rad_s=channel("speed_rad_s"),
        direction=channel("direction"),
        acceleration_rad_s2=channel("acceleration_rad_s2"),
        angle_rad=channel("angle_rad"),
        motor_torque_Nm=channel(MOTOR),
        bearing_temperature_degC=channel("temperature_degC"),
        dry_level_Nm=channel("level_Nm"),
        sample_period_s=period_s,
        good=np.ones(1, dtype=np.bool_),
        measured_angle_rad=channel("angle_rad"),
    )


def to_json(model: FrictionModel) -> Mapping[str, Any]:
    """Return the model as plain content: constants, formulas, what is not held."""
    wheel = model.wheel
    return {
        "software": SOFTWARE,
        "wheel": wheel.name,
        "wheel_sha256": wheel.sha256(),
        "report_sha256": model.reports,
        "inputs": dict(INPUTS),
        "output": {"friction_torque_Nm": "N m", "positive": "opposes positive rotation"},
        "base": {
            "formula": r"\tau = \mathrm{level} \operatorname{sign}(\omega) + f_v\, \omega",
            "dry_level_Nm": model.nominal.dry_torque_Nm,
            "dry_level_std_Nm": model.nominal.dry_torque_std_Nm,
            "viscous_Nm_s_rad": model.nominal.viscous_Nm_s_rad,
            "viscous_std_Nm_s_rad": model.nominal.viscous_std_Nm_s_rad,
        },
        "inertia_kg_m2": wheel.inertia_kg_m2,
        "torque_constant_Nm_A": wheel.torque_constant_Nm_A,
        "effects": [_effect_json(part) for part in model.parts],
        "not_held": [{**_effect_json(part), "reason": part.effect.not_exported} for part in model.left_out],
    }


def _effect_json(part: Part) -> dict[str, Any]:
    effect = part.effect
    law = {"law": part.block.law} if part.block.law else {}
    return {"name": part.block.name, **law, "formula": effect.formula, "constants": part.constants()}
