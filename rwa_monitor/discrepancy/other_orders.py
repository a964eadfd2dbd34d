"""Orders that a record of few turns cannot distinguish from the order of a ripple that was found.

Over an angle of a few turns, or one that is travelled to and fro, a line has neighbours that fit nearly as well. An
order is only a name where it has none; else all that fit are reported.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.fitting import EQUIVALENT_WITHIN
from rwa_monitor.discrepancy.models import Model, law_of
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.result import ParameterValue
from rwa_monitor.discrepancy.score import Background
from rwa_monitor.discrepancy.shape_profile import reach_between, shape_limits
from rwa_monitor.discrepancy.terms import make_term
from rwa_monitor.discrepancy.uncertainty import ORDER
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.torque_ripple import MAX_HARMONIC, TorqueRipple, angle_range_turns

WIDTHS: Final = 4.0  # of a line, each way, that are looked at closely
PER_WIDTH: Final = 4  # orders


def with_other_orders(problem: Problem, model: Model, index: int, order: ParameterValue) -> ParameterValue:
    """Add the orders that fit about as well, where there are any: then the order is not determined.

    Parameters
    ----------
    problem, model, index
        The data, the model, and which of its terms the ripple is.
    order
        As it was fitted.
    """
    reach = reach_between(problem, TorqueRipple).get(ORDER)
    if reach is None:
        return order  # so many turns distinguish an order from its neighbours
    low, high = shape_limits(problem, TorqueRipple)[ORDER]
    # Where most of the way is within a part of a turn, peaks are as narrow as the order is known, and not as a line.
    step = reach / PER_WIDTH if order.std is None else min(reach / PER_WIDTH, 0.5 * order.std)
    near = order.value + np.arange(-WIDTHS * reach, WIDTHS * reach + 0.5 * step, step)
    tried = np.unique(np.concatenate([near, np.arange(1.0, MAX_HARMONIC + 1.0)]))
    tried = tried[(tried >= low) & (tried <= high)]
    others = tuple(term for i, term in enumerate(model.terms) if i != index)
    beside = Background.of(problem, others, law_of(model), model.fit.jumps)

    def deviance(at: float) -> float:
        term = make_term(problem, TorqueRipple, {ORDER: at}, None)
        return beside.criterion_with(term) - term.parameters * problem.log_size

    most = deviance(order.value) + EQUIVALENT_WITHIN
    fitting = tried[[deviance(float(at)) < most for at in tried]]
    far = np.abs(fitting - order.value) > reach
    far &= np.abs(2.0 * fitting - order.value) > reach  # a half is the same by its double
    if not far.any():
        return order
    turns = max(angle_range_turns(record.undrifted) for record in problem.records)
    fitting = np.union1d(fitting[far], order.value)
    note = f"not determined: {_in_words(fitting, reach)} fit about as well over {turns:.2g} turns"
    return replace(order, std=None, note=note)


def _in_words(orders: FloatArray, reach: float) -> str:
    """Return ranges of orders, those nearer than a line's width joined."""
    parts = np.split(orders, np.flatnonzero(np.diff(orders) > reach) + 1)
    return ", ".join(f"{part[0]:.3g}" if part.size == 1 else f"{part[0]:.3g} to {part[-1]:.3g}" for part in parts)
