"""Which names count as the same answer, by manoeuvre and channels: fixed here by physics, never taken from the package.

Two names are equivalent where no record of this kind could distinguish them.
"""

from __future__ import annotations

from benchmarks.blind.generator import Case

# K_T·I - J·dω/dt: an error of K_T equals an error of J up to a factor on all friction, which is a free parameter.
# Without the voltage no record of current and speed distinguishes them.
BALANCE = frozenset({"inertia_error", "torque_constant_error"})

# Where the motor torque always has the sign of the speed, |K_T I|·s equals K_T I: in one direction, and on a geared
# joint, whose friction is larger than the accelerating torque.
LOAD = frozenset({"inertia_error", "torque_constant_error", "load_dependence"})

# Only level jumps in both directions distinguish a constant offset from one in proportion to the level; a plain swing
# has a few jumps in each half at most.
OFFSET = frozenset({"torque_bias", "coulomb_asymmetry"})

# A plain swing passes zero always at about the same acceleration: an angle then corresponds to a fixed time.
REVERSAL = frozenset({"presliding", "current_delay"})

# Slow changes in one direction, where temperature, time and the lag of the lubricant are collinear.
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
