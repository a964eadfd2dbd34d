"""Formulas of a small grammar: a law for friction that no effect of the catalogue explains.

A structure is a carrier times a function of one variable, such as "dry*tanh(speed)", a·tanh(|ω|/ω0)·sign ω. Every
function takes a dimensionless argument, a constant's unit follows from the variable, and that of the strength from the
carrier. No structure has more than three constants. Structures are classes like the effects of the catalogue, but not
in it: a wheel file names them as the effect "formula" with the key `law`, which is looked up and never evaluated.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar, Final, NamedTuple, cast

import numpy as np

from rwa_monitor.errors import InputError, did_you_mean
from rwa_monitor.kernels.effects import time_since
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory, Parameter, Shape, follow, stack
from rwa_monitor.wheel.effects.drag_laws import WIDEST_SHARE, ORIGIN_degC
from rwa_monitor.wheel.effects.torque_ripple import TorqueRipple, angle_turned

BLOCK: Final = "formula"  # the name of the effect in a wheel file
RESOLVED_STEPS: Final = 3.0  # changes of a variable from slot to slot: a narrower feature falls between samples
FINEST_SHARE: Final = 0.02  # of the largest value: a smaller scale cannot be distinguished from a step at zero
INSIDE_SHARE: Final = 0.05  # of the range: a centre nearer to an end has too few samples beyond it
SLEW_QUANTILE: Final = 0.99  # of |dω/dt|: higher values of single samples are noise


class Function(NamedTuple):
    """A function of one variable.

    Attributes
    ----------
    text
        With placeholders: {x}, the variable, {one}, its unit, and the constants by role.
    roles
        Of its constants, in the order of the arguments of `value`.
    value
        Its value, float64 (n,) or (strengths, n), from the variable and the constants.
    strengths
        Endings of the strengths' names, a column each.
    """

    text: str
    roles: tuple[str, ...]
    value: Callable[..., FloatArray]
    strengths: tuple[str, ...] = ("",)


class Variable(NamedTuple):
    """A quantity that a formula is a function of.

    Attributes
    ----------
    symbol, unit, words
        For the text of a formula.
    functions
        Names of the functions that are tried on it.
    constants
        Symbol and parameter by role.
    values
        The quantity, float64 (n,), and the memory, from channels, shape and memory.
    origin
        Subtracted from the values where a function has no centre of its own.
    own
        Roles of the constants that `values` itself needs.
    needs
        Optional channels that it needs.
    """

    symbol: str
    unit: str
    words: str
    functions: tuple[str, ...]
    constants: Mapping[str, tuple[str, Parameter]]
    values: Callable[[Channels, Shape, Memory], tuple[FloatArray, Memory]]
    origin: float = 0.0
    own: tuple[str, ...] = ()
    needs: frozenset[str] = frozenset()


class Carrier(NamedTuple):
    """A factor that gives the direction: its text, the unit of the strength and its ending, and its values."""

    text: str
    unit: str
    ending: str
    values: Callable[[Channels], FloatArray]


def _since_slew(channels: Channels, shape: Shape, memory: Memory) -> tuple[FloatArray, Memory]:
    """Return the time since |dω/dt| was last above α0 [s], infinite before the first; and the memory."""
    rate, every = channels.acceleration_rad_s2, np.ones(len(channels), dtype=np.bool_)
    return follow(time_since, rate, every, channels.sample_period_s, shape["slew_rad_s2"], memory, (np.inf,))


def _shown_slew(channels: Channels) -> tuple[float, float]:
    slew = float(np.quantile(channels.known(np.abs(channels.acceleration_rad_s2)), SLEW_QUANTILE))
    return 2 * INSIDE_SHARE * slew, (1.0 - 2 * INSIDE_SHARE) * slew


FUNCTIONS: Final = {
    "linear": Function("a·{x}/{one}", (), lambda x: x),
    "power": Function("a·({x}/{one})^{exponent}", ("exponent",), np.power),
    "tanh": Function("a·tanh({x}/{scale})", ("scale",), lambda x, scale: np.tanh(x / scale)),
    "decay": Function("a·exp(-{x}/{scale})", ("scale",), lambda x, scale: np.exp(-x / scale)),
    "growth": Function("a·exp({x}/{scale})", ("scale",), lambda x, scale: np.exp(x / scale)),
    "lorentz": Function("a/(1+({x}/{scale})^2)", ("scale",), lambda x, scale: 1.0 / (1.0 + (x / scale) ** 2)),
    "log": Function("a·ln(1+{x}/{scale})", ("scale",), lambda x, scale: np.log1p(x / scale)),
    "hinge": Function("a·max({x}-{centre},0)/{one}", ("centre",), lambda x, centre: np.maximum(x - centre, 0.0)),
    "bump": Function(
        "a·exp(-(({x}-{centre})/{width})^2)",
        ("centre", "width"),
        lambda x, centre, width: np.exp(-(((x - centre) / width) ** 2)),
    ),
    "step": Function(
        "a/(1+exp(-({x}-{centre})/{width}))",
        ("centre", "width"),
        lambda x, centre, width: 0.5 * (1.0 + np.tanh(0.5 * (x - centre) / width)),
    ),
    "wave": Function(
        "(a·cos({order}·{x})+b·sin({order}·{x}))",
        ("order",),
        lambda x, order: np.stack([np.cos(order * x), np.sin(order * x)]),
        ("_cos", "_sin"),
    ),
}

VARIABLES: Final = {
    "speed": Variable(
        "|ω|",
        "rad/s",
        "|speed|",
        ("power", "tanh", "decay", "lorentz", "log", "hinge", "bump", "step"),
        {
            "scale": ("ω0", Parameter("speed_scale_rad_s", "rad/s", 1e-6, 1e6, 50.0)),
            "centre": ("ω0", Parameter("speed_centre_rad_s", "rad/s", 1e-6, 1e6, 50.0)),
            "width": ("w", Parameter("speed_width_rad_s", "rad/s", 1e-6, 1e6, 10.0)),
            "exponent": ("p", Parameter("exponent", "-", 0.1, 4.0, 0.5)),
        },
        lambda channels, *_: (np.abs(channels.speed_rad_s), None),
    ),
    "temperature": Variable(
        "T",
        "K",
        "temperature",
        ("linear", "decay", "growth", "hinge", "bump", "step"),
        {
            "scale": ("w", Parameter("temperature_scale_K", "K", 1.0, 1e4, 10.0)),
            "centre": ("T0", Parameter("temperature_centre_degC", "°C", -273.15, 1e3, 25.0)),
            "width": ("w", Parameter("temperature_width_K", "K", 1e-3, 1e3, 3.0)),
        },
        lambda channels, *_: (channels.optional("bearing_temperature_degC"), None),
        ORIGIN_degC,
        needs=frozenset({"bearing_temperature_degC"}),
    ),
    "time": Variable(
        "t",
        "s",
        "time",
        ("decay", "log"),
        {"scale": ("τ", Parameter("time_scale_s", "s", 1e-6, 1e9, 100.0))},
        lambda channels, *_: (channels.time_s, None),
    ),
    "slew": Variable(
        "t_slew",
        "s",
        "time since a slew",
        ("decay",),
        {
            "slew": ("α0", Parameter("slew_rad_s2", "rad/s²", 1e-9, 1e9, 1.0, shown=_shown_slew)),
            "scale": ("τ", Parameter("time_scale_s", "s", 1e-6, 1e9, 20.0)),
        },
        _since_slew,
        own=("slew",),
    ),
    "angle": Variable(
        "θ",
        "rad",
        "angle",
        ("wave",),
        {"order": ("k", replace(TorqueRipple.parameters[-1], name="order"))},
        lambda channels, _, memory: angle_turned(channels, memory),
    ),
}

CARRIERS: Final = {
    "dry": Carrier("·sign ω", "N m", "_Nm", lambda channels: channels.direction),
    "viscous": Carrier("·ω", "N m s/rad", "_Nm_s_rad", lambda channels: channels.speed_rad_s),
    "even": Carrier("", "N m", "_Nm", lambda channels: np.ones(len(channels))),
}
RANGED: Final = ("scale", "centre", "width")  # roles whose identifiable range the variable's range in a record limits


class Formula(MeanEffect):
    """A carrier times a function of one variable; `FORMULAS` holds a class for each structure.

    Where a nonparametric curve remains that no effect of the catalogue explains, the structures of a small grammar are
    fitted together with everything else, as the effects are: a carrier (dry: sign ω, viscous: ω, even: no direction)
    times a function of one variable. A formula that is found describes the records that it was fitted to, over the
    range that they cover. It has no physics in it and names no cause.

    References
    ----------
    No law of physics: a fixed grammar. The choice among its structures is priced by a uniform prior over them; priors
    over formulas: R. Guimerà et al., A Bayesian machine scientist to aid in the solution of challenging scientific
    problems, Science Advances 6, 2020.
    """

    law: ClassVar[str]  # the structure's id: carrier*function(variable)
    text: ClassVar[str]  # the formula as a person writes it, in plain characters
    symbols: ClassVar[Mapping[str, str]]  # in the text, by the parameter's name
    carrier: ClassVar[str]
    function: ClassVar[str]
    variable: ClassVar[str]
    separate_by = "A cause is found by other means; other records over the same range show whether the formula holds."

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        """Return carrier × function, a column for each strength."""
        variable, function = VARIABLES[cls.variable], FUNCTIONS[cls.function]
        x, memory = variable.values(channels, shape, memory)
        if "centre" not in function.roles:
            x = x - variable.origin
        value = function.value(x, *(shape[variable.constants[role][1].name] for role in function.roles))
        carrier = CARRIERS[cls.carrier].values(channels)
        return stack(*(row * carrier for row in np.atleast_2d(value))), memory


def _shown(name: str, role: str, channels: Channels) -> tuple[float, float]:
    """Return the identifiable range: scales up to the largest value, centres inside the range, widths up to half of it.

    Scales and widths are no smaller than the samples resolve.
    """
    values = channels.known(VARIABLES["time" if name == "slew" else name].values(channels, {}, None)[0])
    low, high, size = float(values.min()), float(values.max()), float(np.max(np.abs(values - VARIABLES[name].origin)))
    margin = INSIDE_SHARE * (high - low)
    if role == "centre":
        return low + margin, high - margin
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0]
    step = RESOLVED_STEPS * float(np.median(steps)) if steps.size else 0.0
    if role == "width":
        return max(step, FINEST_SHARE * (high - low)), WIDEST_SHARE * (high - low)
    seen_from = 0.0 if VARIABLES[name].origin else low  # of a smaller scale only a tail is in the data
    return max(step, FINEST_SHARE * size, seen_from), size


def _structure(carrier: str, function: str, variable: str) -> type[Formula]:
    """Make the class of a structure."""
    law = f"{carrier}*{function}({variable})"
    of, over, factor = FUNCTIONS[function], VARIABLES[variable], CARRIERS[carrier]
    strengths = tuple(
        Parameter(f"strength{end}{factor.ending}", factor.unit, -np.inf, np.inf, 0.0 if i else 1e-5, linear=True)
        for i, end in enumerate(of.strengths)
    )
    constants = {role: over.constants[role] for role in (*over.own, *of.roles)}
    parameters = [
        replace(parameter, shown=partial(_shown, variable, role)) if role in RANGED else parameter
        for role, (_, parameter) in constants.items()
    ]
    shifted = over.origin and "centre" not in of.roles
    text = of.text.format(
        x=f"({over.symbol}-{over.origin:g} °C)" if shifted else over.symbol,
        one=f"(1 {over.unit})",
        **{role: symbol for role, (symbol, _) in over.constants.items()},
    )
    body: dict[str, Any] = {
        "__module__": __name__,
        "__qualname__": f"{Formula.__name__}.{law}",
        "__doc__": f"{text}{factor.text}.",
        "name": f"{BLOCK} {law}",
        "title": f"Formula {law}",
        "law": law,
        "text": text + factor.text,
        "formula": rf"\tau = {_latex(text + factor.text)}",
        "symbols": {
            **{parameter.name: "ab"[i] for i, parameter in enumerate(strengths)},
            **{parameter.name: symbol for symbol, parameter in constants.values()},
        },
        "signature": f"A {'torque' if carrier == 'even' else 'drag'} that depends on {over.words}.",
        "carrier": carrier,
        "function": function,
        "variable": variable,
        "needs": over.needs,
        "parity": "none" if variable == "angle" else "even" if carrier == "even" else "odd",
        "parameters": (*strengths, *parameters),
    }
    structure = cast("type[Formula]", type(law, (Formula,), body))
    setattr(Formula, law, structure)  # where pickle finds it: a module-level class would be registered in the catalogue
    return structure


def _latex(text: str) -> str:
    """Return a formula's text as LaTeX."""
    text = re.sub(r"([ωTα])0", r"\1_0", text.replace("t_slew", "t_{slew}").replace("·", r"\, "))
    text = re.sub(r"[a-z]{2,}", r"\\operatorname{\g<0>}", text).replace(" °C", r"\,^\circ\mathrm{C}")
    for letter, name in {"ω": "omega", "τ": "tau", "θ": "theta", "α": "alpha"}.items():
        text = text.replace(letter, rf"\{name} ")
    return text


_STRUCTURES = (_structure(c, f, v) for v, variable in VARIABLES.items() for f in variable.functions for c in CARRIERS)
FORMULAS: Final = {structure.law: structure for structure in _STRUCTURES}
del FORMULAS["viscous*power(speed)"]  # equals dry*power(speed) with another exponent
Formula.choice_deviance = 2.0 * float(np.log(len(FORMULAS)))


def parse(law: str) -> type[Formula]:
    """Return the structure with an id; spaces are ignored.

    Raises
    ------
    InputError
        If the grammar has no such structure.
    """
    structure = FORMULAS.get("".join(law.split()))
    if structure is None:
        hint = did_you_mean(law, FORMULAS) or f"; one is {next(iter(FORMULAS))!r}"
        raise InputError(f"effect {BLOCK}", f"{law!r} is no law of the grammar{hint}", "law")
    return structure
