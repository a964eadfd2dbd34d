"""A slice of the fault campaign, in which every fault occurs."""

import os

import pytest

from tests.faults.history import LOSING, RECOVERABLE, make_history
from tests.faults.trial import losing, run_trial

SEED = 6
SLICE = (2, 7, 9, 24, 41, 46, 57, 67)


@pytest.mark.processes
@pytest.mark.parametrize("number", SLICE)
def test_a_history_breaks_no_promise(number: int) -> None:
    outcome = run_trial(SEED, number, root=os.geteuid() == 0)
    assert outcome.problems == [], outcome.talk
    assert outcome.windows > 0 or losing(outcome.kinds)
    assert outcome.wrong == 0


def test_the_slice_holds_every_fault() -> None:
    kinds = {kind for number in SLICE for kind in make_history(SEED, number, root=True).kinds}
    assert kinds == {*RECOVERABLE, *LOSING}


def test_a_history_is_made_of_its_seed_and_number_alone() -> None:
    one, again, other = (make_history(SEED, number, root=True) for number in (3, 3, 3 + len(RECOVERABLE)))
    assert one.puts == again.puts
    assert one.faults == again.faults
    assert one.puts != other.puts
