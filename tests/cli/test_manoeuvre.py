"""`rwa-monitor manoeuvre` as a user runs it."""

from __future__ import annotations

import json

from tests.program import run


def test_a_line_for_each_change_of_speed_and_the_same_in_json() -> None:
    table = run("manoeuvre", "viscous", "--speed", "200")
    assert table.exit_code == 0, table.stderr
    found = json.loads(run("manoeuvre", "viscous", "--speed", "200", "--json").stdout)
    assert (found["doubt"], found["certainty"]) == ("viscous", 0.95)
    for one in found["manoeuvres"]:
        assert f"{one['duration_s']:.0f}" in table.stdout


def test_what_no_change_decides_is_exit_code_1() -> None:
    surest = run("manoeuvre", "dry", "--speed", "10000")
    assert surest.exit_code == 1
    assert "no change of speed within the wheel's limits" in surest.stderr
