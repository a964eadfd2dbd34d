"""The friction model of a wheel as other simulators take it: its constants, its law in C, and what it does not hold.

The torque is that of the simulation: dry level and viscous friction, then what the effects of the wheel file add. It is
what resists in J·dω/dt = K_T·I − torque with J and K_T of the wheel file, so effects of a wrong J or K_T are held too.
Those that follow the motor torque take J·dω/dt plus the whole friction for it, and the loop is solved as the simulation
solves it.

Its law in C is written down by the classes of the effects, through channels that record what is done to them: a formula
stands in the class of its effect alone. A recorded channel passes for a NumPy array of one slot, through NumPy's own
protocols for other array types (NEP 13 and 18). What is computed with it becomes an expression; a constant stays a
number. Recursions of the kernels, which have a memory, become a call of the C function that the kernels themselves loop
over.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Final, NamedTuple, cast

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from rwa_monitor.errors import InputError
from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.wheel.effects.base import Channels, Effect, MeanEffect
from rwa_monitor.wheel.effects.catalogue import build
from rwa_monitor.wheel.effects.formula import Formula
from rwa_monitor.wheel.effects.switching_base import Jumps, SwitchingEffect
from rwa_monitor.wheel.wheel import EffectBlock, Nominal, Wheel
from rwa_monitor.words import SOFTWARE

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


# ---- channels that write down, in C, what an effect does to them -----------------------------------------------------


Cell = str | float | bool  # an expression in C, or a constant

OPERATORS: Final[dict[np.ufunc, str]] = {
    np.add: "+",
    np.subtract: "-",
    np.multiply: "*",
    np.divide: "/",
    np.less: "<",
    np.less_equal: "<=",
    np.greater: ">",
    np.greater_equal: ">=",
    np.equal: "==",
    np.not_equal: "!=",
    np.bitwise_and: "&&",
    np.logical_and: "&&",
    np.bitwise_or: "||",
    np.logical_or: "||",
}
CALLS: Final[dict[np.ufunc, str]] = {
    np.negative: "(-{0})",
    np.positive: "{0}",
    np.invert: "(!{0})",
    np.logical_not: "(!{0})",
    np.isnan: "(isnan({0}) != 0)",
    np.isfinite: "(isfinite({0}) != 0)",
    np.absolute: "fabs({0})",
    np.sign: "rwa_sign({0})",
    np.square: "({0} * {0})",
    np.power: "pow({0}, {1})",
    np.maximum: "(({0} < {1}) ? {1} : {0})",  # NaN in the first stays NaN, as NumPy has it
    np.minimum: "(({1} < {0}) ? {1} : {0})",
    np.arctan: "atan({0})",
} | {
    ufunc: f"{ufunc.__name__}({{0}})"
    for ufunc in (np.exp, np.expm1, np.log, np.log1p, np.sqrt, np.tanh, np.sinh, np.cosh, np.sin, np.cos, np.tan)
}
REPEATED: Final = (np.square, np.maximum, np.minimum)  # their operands stand twice, and get a name first
NEUTRAL: Final[dict[np.ufunc, Cell]] = {np.add: 0.0, np.multiply: 1.0, np.bitwise_and: True, np.logical_and: True}
SHAPERS: Final = (np.stack, np.atleast_2d)  # they move cells, and change none


def literal(cell: Cell) -> str:
    """Return a cell as C has it: a double that reads back to the same bits."""
    if isinstance(cell, str):
        return cell
    if isinstance(cell, bool | np.bool_):
        return str(bool(cell)).lower()
    if not math.isfinite(cell):
        return "((double)NAN)" if math.isnan(cell) else "((double)INFINITY)" if cell > 0 else "(-(double)INFINITY)"
    return repr(float(cell)) if math.copysign(1.0, cell) > 0 else f"({float(cell)!r})"


class Recorder:
    """What the effects of a model have written down so far.

    Attributes
    ----------
    statements
        In C, in their order; `take` hands over those since the last time.
    memory
        The start values of the state of all recursions.
    """

    def __init__(self) -> None:
        self.statements: list[str] = []
        self.memory: list[float] = []
        self._names = 0

    def channel(self, name: str) -> Recorded:
        """Return a channel of one slot, which is a variable in C."""
        return Recorded(self, np.array([name], dtype=object))

    def take(self) -> tuple[str, ...]:
        """Return the statements written since the last call."""
        taken, self.statements = tuple(self.statements), []
        return taken

    def named(self, cell: Cell, const: bool = True) -> Cell:
        """Return a variable that holds an expression; what is a variable or a number already stays."""
        if not isinstance(cell, str) or (cell.isidentifier() and const):
            return cell
        self._names += 1
        self.statements.append(f"{'const ' if const else ''}double x{self._names} = {cell};")
        return f"x{self._names}"

    def apply(self, ufunc: np.ufunc, *cells: Cell) -> Cell:
        """Return what a function makes of cells, worked out where all are numbers."""
        if not any(isinstance(cell, str) for cell in cells):
            return ufunc(*cells).item()  # type: ignore[no-any-return]
        if ufunc in NEUTRAL:
            for one, other in (cells, cells[::-1]):
                if not isinstance(one, str) and one == NEUTRAL[ufunc]:
                    return other
        if ufunc in REPEATED:
            cells = tuple(self.named(cell) for cell in cells)
        texts = [literal(cell) for cell in cells]
        if ufunc in OPERATORS:
            return f"({f' {OPERATORS[ufunc]} '.join(texts)})"
        return CALLS[ufunc].format(*texts)

    def select(self, condition: Cell, one: Cell, other: Cell) -> Cell:
        """Return one cell where a condition holds, else another."""
        if not isinstance(condition, str):
            return one if condition else other
        return f"({condition} ? {literal(one)} : {literal(other)})"


class Recorded(NDArrayOperatorsMixin):
    """An array, of any shape, of expressions in C: `cells` is of dtype object."""

    def __init__(self, recorder: Recorder, cells: Any) -> None:
        self._recorder = recorder
        self.cells = np.asarray(cells, dtype=object)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Recorded:
        """Write down a function of NumPy; `out`, of an operation in place, becomes the result."""
        if method != "__call__" or not (ufunc in OPERATORS or ufunc in CALLS) or options.keys() - {"out"}:
            raise _not_known(ufunc.__name__)
        return self._each(partial(self._recorder.apply, ufunc), *inputs)

    def __array_function__(self, function: Callable[..., Any], _: Any, inputs: Any, options: Any) -> Recorded:
        """Write down a choice between values, or move them."""
        if function is np.where:
            return self._each(self._recorder.select, *inputs)
        if function not in SHAPERS:
            raise _not_known(function.__name__)
        return Recorded(self._recorder, function(*(_cells(one) for one in inputs), **options))

    def _each(self, function: Callable[..., Cell], *inputs: Any) -> Recorded:
        return Recorded(self._recorder, np.frompyfunc(function, len(inputs), 1)(*map(_cells, inputs)))

    def follow(self, recursion: str, usable: BoolArray, parameter: float, state: FloatArray) -> Recorded:
        """Write down a step of a recursion of the kernels, whose state goes on where the slot is not usable."""
        recorder, (value,), (known,) = self._recorder, self.cells, _cells(usable)
        memory = f"state->memory[{len(recorder.memory)}]"
        recorder.memory += state.tolist()
        step = f"rwa_{recursion}(&{memory}, {literal(value)}, step_s, {literal(parameter)})"
        if not isinstance(known, str):
            return Recorded(recorder, [recorder.named(step)])
        name = recorder.named(memory, const=False)
        recorder.statements.append(f"if {known} {{ {name} = {step}; }}")
        return Recorded(recorder, [name])

    @property
    def size(self) -> int:
        return int(self.cells.size)

    @property
    def shape(self) -> tuple[int, ...]:
        return self.cells.shape

    @property
    def T(self) -> Recorded:
        return Recorded(self._recorder, self.cells.T)

    def __getitem__(self, key: Any) -> Recorded:
        return Recorded(self._recorder, self.cells[key])

    def __iter__(self) -> Iterator[Recorded]:
        return (self[i] for i in range(len(self.cells)))

    def __bool__(self) -> bool:
        raise _not_known("an if on a channel")

    def astype(self, _: Any) -> Recorded:
        """All are doubles."""
        return self


def _cells(value: Any) -> Any:
    """Return the cells of an array, of arrays in a row, or of a number."""
    if isinstance(value, list | tuple):
        return [_cells(one) for one in value]
    return value.cells if isinstance(value, Recorded) else np.asarray(value, dtype=object)


def _not_known(what: str) -> InputError:
    return InputError("export", f"{what} has no counterpart in C; write the effect's column with plain functions")
