"""What counts as the same answer, by manoeuvre and channels: fixed here by physics, never taken from the tool.

Two names are equivalent where no record of this kind could separate them.
"""

from __future__ import annotations

from benchmarks.blind.generator import Case

# K_T·I - J·dω/dt: an error of K_T is an error of J up to a factor on all friction, which is free. Without the voltage
# no record of current and speed separates them.
BALANCE = frozenset({"inertia_error", "torque_constant_error"})

# Where the motor torque does not change sign against the motion, |K_T I|·s is K_T I: in one direction, and on a geared
# joint, whose friction is larger than what accelerates it.
LOAD = frozenset({"inertia_error", "torque_constant_error", "load_dependence"})

# Only level jumps in both directions separate an offset from one in proportion to the level; a plain swing has a
# few jumps in each half at most.
OFFSET = frozenset({"torque_bias", "coulomb_asymmetry"})

# A plain swing passes zero at about one acceleration: an angle, then, is a time.
REVERSAL = frozenset({"presliding", "current_delay"})

# Slow changes in one direction, where temperature, time and the lag of the lubricant all go one way.
SLOW = frozenset({"viscosity_temperature", "run_in_drift", "lubricant_lag"})

CLASSES: dict[str, tuple[frozenset[str], ...]] = {
    "one_direction": (BALANCE, LOAD, SLOW),
    "crossings": (BALANCE, OFFSET, REVERSAL),
    "rich": (BALANCE,),
}


def accepted(name: str, case: Case) -> frozenset[str]:
    """Return the names that are right where `name` is hidden in a record of this case."""
    same = frozenset({name})
    groups = (*CLASSES[case.manoeuvre], LOAD) if case.scale == "joint" else CLASSES[case.manoeuvre]
    for group in groups:
        if name in group:
            same |= group
    return same
