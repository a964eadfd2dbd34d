"""Channels that write down, in C, what an effect does to them: a formula stands in the class of its effect alone.

A recorded channel passes for a NumPy array of one slot, through NumPy's own protocols for other array types (NEP 13 and
18). What is computed with it becomes an expression; a constant stays a number. Recursions of the kernels, which have a
memory, become a call of the C function that the kernels themselves loop over.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from rwa_monitor.errors import InputError
from rwa_monitor.samples import BoolArray, FloatArray

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
