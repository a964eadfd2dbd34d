"""Stage 3 on simulated windows: accuracy beside the paper's method, properties, rare events, bounds on work."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwa_monitor.changepoints.evidence import WindowAccumulator
from rwa_monitor.changepoints.stage_results import REJECTED, UNATTRIBUTED, Assignment, Evidence
from rwa_monitor.paper.method import split_friction
from rwa_monitor.switching.assignment import assign
from rwa_monitor.wheel.durations import Geometric, Histogram, Lognormal, Weibull
from rwa_monitor.wheel.wheel import SwitchingSystem, Wheel, built_in_wheel
from tests.switching.assignment_windows import STD, candidates_at, evidence_at, evidence_of, simulate, system, window

WHEEL = built_in_wheel()
TOLERANCE = 5  # slots


def accepted(assignment: Assignment) -> list[tuple[int, int, int]]:
    rows = zip(assignment.index, assignment.system, assignment.direction, strict=True)
    return [(int(k), int(s), int(d)) for k, s, d in rows if s != REJECTED]


def matched(found: list[tuple[int, int, int]], jumps: list[tuple[int, int, int]]) -> tuple[int, int]:
    """Count jumps found in place, system and direction; and changepoints left over."""
    left = list(found)
    good = 0
    for k, s, d in jumps:
        near = [one for one in left if abs(one[0] - k) <= TOLERANCE and one[1:] == (s, d)]
        if near:
            left.remove(min(near, key=lambda one: abs(one[0] - k)))
            good += 1
    return good, len(left)


def detect(x: np.ndarray, z: np.ndarray, direction: int) -> Evidence:
    """Run stage 1 on SI values made of the normalised ones."""
    speed = direction * x * WHEEL.nominal.nominal_speed_rad_s
    torque = direction * z * WHEEL.nominal.dry_torque_Nm
    accumulator = WindowAccumulator(WHEEL)
    accumulator.append(speed, torque, np.ones(x.size, dtype=np.bool_))
    return accumulator.close()


def with_systems(*systems: SwitchingSystem) -> Wheel:
    return WHEEL.model_copy(update={"fss": systems})


def test_places_jumps_of_the_examples_on_the_right_system():
    """Issue 2: at least 99 % of the visible jumps in place and system, under 0.1 false ones a window."""
    windows = 30
    counts = {"joint": [0, 0, 0], "paper": [0, 0, 0]}  # good, all, false
    rng = np.random.default_rng(20)
    for number in range(windows):
        x, z, jumps, _, _ = simulate(WHEEL, rng)
        evidence = detect(x, z, 1 if number % 2 else -1)
        for method, run in (("joint", assign), ("paper", split_friction)):
            good, false = matched(accepted(run(evidence, WHEEL)[0]), jumps)  # type: ignore[operator]
            for place, value in enumerate((good, len(jumps), false)):
                counts[method][place] += value
    good, total, false = counts["joint"]
    # A sojourn of one or two slots (1 % of those of fss_1) may leave no candidate: that is what 99 % allows.
    assert good >= 0.99 * total
    assert false < 0.1 * windows
    assert 0.9 * total <= counts["paper"][0] < good


NONE = with_systems()
ONE = with_systems(WHEEL.fss[1])
THREE = with_systems(
    *WHEEL.fss, system("slow", Weibull(shape=1.5, scale=25_000.0), Lognormal(mu=8.5, sigma=0.4), low=0.15, high=0.25)
)
OTHER_LAWS = with_systems(
    system("bursts", Geometric(mean=12_000), Lognormal(mu=4.0, sigma=0.5)),
    system("cage", Weibull(shape=3.0, scale=20_000.0), Histogram(edges=(8_000, 15_000, 25_000), weights=(1.0, 3.0))),
)


@pytest.mark.parametrize(
    ("wheel", "false_candidates", "right", "wrong"),
    [(WHEEL, 10.0, 0.99, 0.0), (ONE, 2.0, 0.99, 0.01), (THREE, 2.0, 0.97, 0.03), (OTHER_LAWS, 2.0, 0.97, 0.03)],
    ids=["many false candidates", "one", "three", "other laws"],
)
def test_jumps_are_assigned_and_false_candidates_rejected(wheel, false_candidates, right, wrong):
    rng = np.random.default_rng(22)
    good = total = false = 0
    for _ in range(20):
        made = window(wheel, rng, false_candidates=false_candidates, jitter=0)
        assignment, _ = assign(made.evidence, wheel)
        hits, extra = matched(accepted(assignment), made.jumps)
        good, total, false = good + hits, total + len(made.jumps), false + extra
        assert len(assignment.configurations) == len(wheel.fss)
    assert good >= right * total
    assert false <= wrong * total + 1


def test_a_wheel_without_switching_systems_still_finds_levels():
    rng = np.random.default_rng(23)
    x = np.full(20_000, 0.5)
    z = 1.5 + STD * rng.standard_normal(x.size)
    z[8_000:] += 0.3
    assignment, levels = assign(evidence_at(x, z, [3_000, 8_000, 15_000]), NONE)
    assert accepted(assignment) == [(8_000, UNATTRIBUTED, 1)]
    assert assignment.configurations == ()
    assert np.diff(levels.level) == pytest.approx([0.3], abs=0.01)


def steps(levels: dict[int, float], slots: int = 80_000) -> tuple[np.ndarray, np.ndarray]:
    """Make x and a noisy z that starts at 1.6 and changes by the given steps."""
    rng = np.random.default_rng(25)
    x = 0.6 + 0.3 * np.sin(np.arange(slots) / 7000.0)
    z = 1.0 + x + STD * rng.standard_normal(slots)
    for k, step in levels.items():
        z[k:] += step
    return x, z


def test_two_systems_jump_at_once():
    # fss_2 up at 20,000 and down at 45,000, at that very slot fss_1 up; fss_1 down 100 slots later; pulses between.
    jumps = {9_000: 0.4, 9_100: -0.4, 20_000: 0.55, 26_000: 0.5, 26_080: -0.5, 45_000: -0.55 + 0.35, 45_100: -0.35}
    jumps |= {60_000: 0.45, 60_050: -0.45, 71_000: 0.5}
    x, z = steps(jumps)
    assignment, _ = assign(evidence_at(x, z, jumps), WHEEL)
    at_once = [one for one in accepted(assignment) if one[0] == 45_000]
    assert sorted(at_once) == [(45_000, 0, 1), (45_000, 1, -1)]
    sizes = {
        int(s): float(j)
        for k, s, j in zip(assignment.index, assignment.system, assignment.jump, strict=True)
        if k == 45_000
    }
    assert sizes[0] == pytest.approx(0.35, abs=0.02)
    assert sizes[1] == pytest.approx(-0.55, abs=0.02)


def test_a_missed_jump_costs_only_itself():
    """fss_1 goes up, but its return left no candidate (it lies in a gap): all other jumps are right."""
    jumps = {9_000: 0.4, 9_100: -0.4, 20_000: 0.55, 24_000: 0.5, 24_150: -0.5, 38_000: 0.35, 38_060: -0.35}
    jumps |= {45_000: -0.55, 53_000: 0.45, 53_050: -0.45, 66_000: 0.5, 66_100: -0.5}
    x, z = steps(jumps)
    seen = [k for k in jumps if k != 38_060]
    used = np.ones(x.size, dtype=bool)
    used[38_003:38_400] = False
    found = accepted(assign(evidence_at(x, z, seen, used), WHEEL)[0])
    expected = {(k, 1 if k in (20_000, 45_000) else 0, 1 if jumps[k] > 0 else -1) for k in seen if k != 38_000}
    assert expected <= set(found)


def test_an_impossible_jump_is_unattributed():
    """A level that climbs five times is no path that two systems can make."""
    jumps = dict.fromkeys(range(12000, 80000, 6000), 0.5)
    x, z = steps(jumps)
    assignment, _ = assign(evidence_at(x, z, jumps), WHEEL)
    assert [k for k, _, _ in accepted(assignment)] == list(jumps)
    assert np.count_nonzero(assignment.system == UNATTRIBUTED) >= 5


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
def test_a_jump_that_the_sensor_divides_is_one_jump(share):
    """A sensor that averages over its slot reports a part of a jump in one slot and the rest in the next."""
    jumps = {9_000: 0.4, 9_100: -0.4, 20_000: 0.55, 26_000: 0.5, 26_080: -0.5, 45_000: -0.55}
    systems = {k: 1 if k in (20_000, 45_000) else 0 for k in jumps}
    parts = {k + i: part * jump for k, jump in jumps.items() for i, part in enumerate((share, 1.0 - share))}
    x, z = steps(parts)
    assignment, levels = assign(evidence_at(x, z, parts), WHEEL)
    found = accepted(assignment)
    assert [(s, d) for _, s, d in found] == [(systems[k], 1 if jump > 0 else -1) for k, jump in jumps.items()]
    assert all(0 <= at - k <= 1 for (at, _, _), k in zip(found, jumps, strict=True))
    assert np.diff(levels.level) == pytest.approx(list(jumps.values()), abs=0.03)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 10_000), shift=st.floats(-0.2, 0.3), viscous=st.floats(0.5, 1.5))
def test_shift_and_slope_change_no_attribution(seed, shift, viscous):
    """More base or viscous friction moves no jump: the same noise and jumps give the same attribution."""
    plain = window(WHEEL, np.random.default_rng(seed), jitter=0)
    moved = window(WHEEL, np.random.default_rng(seed), jitter=0, base=1.0 + shift, viscous=viscous)
    assert accepted(assign(plain.evidence, WHEEL)[0]) == accepted(assign(moved.evidence, WHEEL)[0])


def test_scale_changes_no_attribution():
    """Twice the torque on a wheel of twice the nominal torque, and a wheel whose torque is not normalised at all."""
    made = window(WHEEL, np.random.default_rng(31), jitter=0)
    bare = Wheel(
        name="bare", sample_period_s=0.125, fss=tuple(s.model_copy(update={"friction": None}) for s in WHEEL.fss)
    )
    expected = accepted(assign(made.evidence, WHEEL)[0])
    for scale in (1.0, 1.6e-3, 40.0):
        candidates = candidates_at(made.x, scale * made.z, made.evidence.candidates.index, scale * STD, scale)
        evidence = evidence_of(made.x, scale * made.z, candidates, scale * STD)
        assert accepted(assign(evidence, bare)[0]) == expected


def test_sojourns_follow_from_the_jumps():
    rng = np.random.default_rng(33)
    for _ in range(10):
        assignment, _ = assign(window(WHEEL, rng).evidence, WHEEL)
        for s, (configurations, starts) in enumerate(zip(assignment.configurations, assignment.starts, strict=True)):
            mine = assignment.system == s
            assert starts[0] == 0
            assert (np.diff(starts) > 0).all()
            assert (np.abs(np.diff(configurations)) == 1).all()
            assert set(assignment.index[mine]) <= set(starts[1:])
        assert ((assignment.confidence >= 0) & (assignment.confidence <= 1)).all()
        assert (np.diff(assignment.index) >= 0).all()


def test_confidence_is_low_where_two_stories_are_as_likely():
    """One small step up in an otherwise silent window: any system may have made it."""
    x, z = steps({70_000: 0.5})
    twins = with_systems(WHEEL.fss[1], WHEEL.fss[1].model_copy(update={"name": "twin"}))
    assignment, _ = assign(evidence_at(x, z, [70_000]), twins)
    assert assignment.confidence[0] == pytest.approx(0.5, abs=0.05)
