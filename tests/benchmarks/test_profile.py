"""`make profile` times functions by their names: they have to be there."""

from benchmarks.profile_live import STAGES


def test_every_stage_of_the_profile_is_still_there() -> None:
    assert [stage for stage, (owner, name) in STAGES.items() if not callable(getattr(owner, name, None))] == []
