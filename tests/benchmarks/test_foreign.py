"""Records of the foreign simulator: what they hide can be found in them, and the judge finds it end to end."""

from pathlib import Path

import numpy as np
import pytest

import rwa_monitor
from benchmarks.foreign.__main__ import judge, targets, to_markdown
from benchmarks.foreign.draws import GAIN, MEAN, NOISE, SIZES, beyond_base, draw_effect, draw_record, plan, write
from benchmarks.foreign.generator import Hidden, System, draw_plant, draw_world, measured

SAMPLES = 6000


def test_two_records_end_to_end() -> None:
    judged = [
        judge(draw_record(names, SAMPLES, np.random.default_rng([3, number])), number)
        for number, names in enumerate([("torque_bias",), ()])
    ]
    assert judged[0].first
    assert judged[0].inside
    (name, true, found, std) = judged[0].estimates[0]
    assert (name, found) == ("torque_bias", pytest.approx(true, abs=4.0 * std))
    assert judged[1].sets == ()
    wanted = targets(judged)
    assert [target.met for target in wanted] == [True, True, True]
    assert "| torque_bias | 1 | 1 |" in to_markdown(judged, wanted, 3, SAMPLES)


def test_a_delay_of_parts_of_a_slot_is_named_once_and_what_it_hid_beside_it() -> None:
    hidden = ("torque_bias", "current_delay")
    found = judge(draw_record(hidden, 20_000, np.random.default_rng([7, 4])), 4)
    assert found.inside
    assert [name for names in found.sets for name in names].count("current_delay") == 1


# What makes jumps, and in which records (seed and number).
JUMPS = {
    # A wheel that lacks nothing, whose systems explain them: uniform laws and few switches, the attribution by the
    # known laws is 180 nepers short of their best; two pulses of derived friction at corners of the speed, a few
    # samples each, one across a gap; pulses at corners within a slew, too small to be jumps, were heavy tails; two
    # samples between corners beside a reversal were a jump that decays.
    None: [(9, 59), (29, 55), (39, 43), (40, 42)],
    # A system as large as known ones, no jump odd by its size: how many are alike shows it, and that they last alike.
    "extra_switching_system": [(16, 38), (26, 18)],
    # Sojourns of a few slots at high speed; in record 6 what no level fits is no ripple, whose phase follows noise.
    "speed_triggered_jumps": [(28, 6), (28, 36)],
    # The noise: they come in clusters, or are of other sizes than those that a system is looked for at.
    "speed_dependent_noise": [(25, 32), (27, 36)],
    "heavy_tailed_noise": [(25, 37)],
    # Two bursts; and noise that grows by 60 %, beside outliers at reversals that no law of the noise fits.
    "cage_instability": [(37, 5), (39, 12)],
    # Viscous friction that jumps by a twentieth at times of its own; beside jumps of the level, short slopes fit, too.
    "viscous_jump": [(34, 12), (40, 2)],
}


@pytest.mark.parametrize(("name", "record"), [(name, one) for name, records in JUMPS.items() for one in records])
def test_jumps_are_named_for_what_makes_them(name: str | None, record: tuple[int, int]) -> None:
    hidden = (name,) if name else ()
    found = judge(draw_record(hidden, 20_000, np.random.default_rng(record)), record[1])
    assert found.sets == ((hidden,) if hidden else ())


def test_the_files_are_those_of_the_program(tmp_path: Path) -> None:
    record = draw_record(("stribeck",), 2000, np.random.default_rng(7))
    samples, wheel = (rwa_monitor.read(write(record, tmp_path)[0]), rwa_monitor.read_wheel(tmp_path / "wheel.toml"))
    np.testing.assert_allclose(samples.speed_rad_s, record.columns["speed_rad_s"], rtol=1e-8)
    assert wheel.inertia_kg_m2 == pytest.approx(record.world.plant.inertia)
    assert [system.name for system in wheel.fss] == [system.name for system in record.declared]


def test_a_plan_hides_everything_and_two_in_one_record_of_five() -> None:
    names = plan(60, np.random.default_rng(0))
    assert {name for hidden in names for name in hidden} == set(SIZES)
    assert [len(hidden) for hidden in names[:10]] == [1, 1, 1, 1, 2, 1, 1, 1, 1, 2]
    assert all(len(set(hidden)) == len(hidden) for hidden in names)


@pytest.mark.parametrize("name", [name for name in (*MEAN, *NOISE) if name not in {"torque_ripple", "current_delay"}])
def test_what_a_size_is_worth_grows_with_it(name: str) -> None:
    rng = np.random.default_rng(11)
    plant = draw_plant(rng, given=True)
    system = System("a", (("geometric", 500.0, 0.0), ("uniform", 100.0, 900.0)), ((0.0, 0.0), (0.3, 0.4)))
    world = draw_world(plant, [system], SAMPLES, rng)
    effect, gain = draw_effect(name, world, rng)
    assert np.isfinite(gain)
    if name in MEAN:
        rest = beyond_base(world, effect)
        assert gain <= float(rest @ rest) + 1e-6
        assert gain > -GAIN[0]


@pytest.mark.parametrize("held", [0.0, 1.0])
def test_a_dead_zone_reads_nothing_new_inside(held: float) -> None:
    rng = np.random.default_rng(4)
    world = draw_world(draw_plant(rng, given=True), [], SAMPLES, rng)
    effect = Hidden("speed_dead_zone", 3.0, {"held": held})
    reading, true = (measured(world, of, np.random.default_rng(1))["speed_rad_s"] for of in ([effect], []))
    inside = np.abs(true) < 3.0
    assert inside.any()
    np.testing.assert_array_equal(reading[~inside], true[~inside])
    np.testing.assert_array_equal(reading[inside], reading[np.flatnonzero(inside) - 1] if held else 0.0)
