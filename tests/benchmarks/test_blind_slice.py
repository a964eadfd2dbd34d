"""A slice of the blind suite: each family of causes, each manoeuvre, each noise, and records that hide nothing."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest
from scipy import stats

from benchmarks.blind.formulas import MEAN
from benchmarks.blind.generator import NOISE_EFFECTS, SWITCHING_EFFECTS, plan
from benchmarks.blind.table import real_names
from benchmarks.blind.trial import run_trial
from rwa_monitor.wheel.effects.catalogue import CATALOGUE

SEED = 20_000  # not a seed on which the search was tried
NAMES = (
    "stribeck",
    "presliding",
    "torque_bias",
    "viscous_asymmetry",
    "viscosity_temperature",
    "sublinear_viscous",
    "quadratic_drag",
    "lubricant_lag",
    "run_in_drift",
    "load_dependence",
    "inertia_error",
    "torque_ripple",
    "coloured_noise",
    "speed_dependent_noise",
    "viscous_jump",
)
RIGHT_FIRST = 0.92  # issue 3: the lower of the two targets
FALSE_NAMES = 0.02
CHANCE = 0.01  # of failing at exactly the target rate
PROCESSOR_S = 240.0  # issue 3: the slice takes under four minutes


# Of these, one of each family, with each manoeuvre and each noise among them: what `make test` has time for.
FEW = ("stribeck", "viscosity_temperature", "inertia_error", "coloured_noise", "viscous_jump")


# One test, since workers that share a module's tests out among them would each run the slice.
@pytest.mark.timeout(1800)  # of the clock, on a machine that does much else; what counts is the processor's time
@pytest.mark.parametrize("names", [FEW, pytest.param(NAMES, marks=pytest.mark.slow)], ids=["few", "all"])
def test_a_slice_of_the_suite(tmp_path: Path, names: tuple[str, ...]) -> None:
    cases = [plan("one", (name,), 2 + 4 * NAMES.index(name), SEED) for name in names]
    cases += [plan("null", (), k, SEED) for k in range(6 if names == NAMES else 2)]
    cases.append(plan("outside", ("bump",), 2, SEED))
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        outcomes = list(pool.map(run_trial, cases, [tmp_path] * len(cases)))
    judged = [o for o in outcomes if o.case.kind == "one" and o.testable]
    missed = [(o.case.effects, [e["name"] for e in o.named]) for o in judged if not o.first_right]
    # As few right ones as a search at its target would show once in a hundred slices.
    assert len(judged) - len(missed) >= stats.binom.ppf(CHANCE, len(judged), RIGHT_FIRST), missed
    nulls = [real_names(o) for o in outcomes if o.case.kind == "null"]
    assert len([names for names in nulls if names]) <= stats.binom.ppf(1 - CHANCE, len(nulls), FALSE_NAMES), nulls
    (outside,) = (o for o in outcomes if o.case.kind == "outside")
    assert outside.verdict == "inadequate"
    assert outside.without_name
    assert not real_names(outside)
    assert sum(outcome.seconds for outcome in outcomes) < PROCESSOR_S


def test_every_effect_of_the_catalogue_can_be_hidden() -> None:
    # A lag of the drive is hidden by `tests/discrepancy/test_smooth.py`: the suite's friction is measured, not derived.
    assert {*MEAN, *NOISE_EFFECTS, *SWITCHING_EFFECTS} == CATALOGUE.keys() - {"drive_lag"}
