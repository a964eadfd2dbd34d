"""How well the check at a window's close sees what the friction model lacks, and how often it cries wolf."""

from __future__ import annotations

import argparse
import multiprocessing
import pickle
import sys
import time
from dataclasses import replace

import numpy as np

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.errors import InputError
from rwa_monitor.live.core import diagnose_samples
from rwa_monitor.physics.datasets import RECIPES, generate
from rwa_monitor.physics.effects.base import Channels, MeanEffect
from rwa_monitor.physics.effects.catalogue import CATALOGUE, to_block
from rwa_monitor.physics.effects.strength import level_columns, strength_for
from rwa_monitor.physics.scenario import Scenario
from rwa_monitor.physics.speed import SpeedProfile
from rwa_monitor.physics.telemetry import Telemetry, simulate
from rwa_monitor.physics.wheel import Wheel

MOTIONS = ("one_direction", "crossings", "rich", "orbit")
EFFECTS = [n for n, e in CATALOGUE.items() if issubclass(e, MeanEffect)]


def channels_of(plain: Telemetry, wheel: Wheel) -> Channels:
    truth = plain.truth
    speed, period = truth.speed_rad_s, wheel.sample_period_s
    motor = truth.motor_torque_Nm - truth.noise_Nm
    return Channels(
        time_s=np.arange(speed.size) * period,
        speed_rad_s=speed,
        direction=np.sign(speed),
        acceleration_rad_s2=truth.acceleration_rad_s2,
        angle_rad=np.concatenate([[0.0], np.cumsum(0.5 * period * (speed[1:] + speed[:-1]))]),
        motor_torque_Nm=motor,
        bearing_temperature_degC=truth.bearing_temperature_degC,
        dry_level_Nm=truth.base_dry_Nm + np.sum(list(truth.fss_friction_Nm.values()), axis=0),
        sample_period_s=period,
        good=~truth.faulty,
        motor_torque_rate_Nm_s=np.gradient(motor, period),
    )


def draw_shape(effect, channels, rng):
    bounds = effect.shape_bounds(channels)
    shape = {}
    for p in effect.shape_parameters():
        if p.choices:
            shape[p.name] = float(rng.choice(p.choices))
        else:
            low, high = bounds[p.name]
            v = p.typical * np.exp(rng.uniform(-0.7, 0.7))
            shape[p.name] = float(np.clip(v, low, high))
    return shape


def effect_windows(args):
    name, motion, seed, sigmas, windows = args
    rng = np.random.default_rng([seed, EFFECTS.index(name), MOTIONS.index(motion)])
    wheel = RECIPES["paper"].wheel(rng)
    seeds = rng.integers(2**63, size=windows)
    scenario = Scenario(speed=SpeedProfile(kind=motion))
    plain = simulate(scenario, wheel, np.random.default_rng(seeds[0]))
    channels = channels_of(plain, wheel)
    effect = CATALOGUE[name]
    levels = level_columns(channels.direction, np.unique(plain.truth.changepoints.index))
    shape = draw_shape(effect, channels, rng)
    try:
        strengths = strength_for(effect, shape, channels, levels, sigmas * plain.truth.noise_std_Nm, rng)
    except InputError as e:
        return (name, motion, seed, str(e), [])
    block = to_block(effect(**shape, **strengths))
    out = []
    from rwa_monitor.diagnosis import adequacy
    carried = None
    for s in seeds:
        scen = Scenario(speed=SpeedProfile(kind=motion), effect=(block,))
        samples = simulate(scen, wheel, np.random.default_rng(s)).samples
        (event,) = diagnose_samples(samples, wheel, built_in_model(), carried=carried)
        d = event.diagnosis
        carried = event.carried
        pass
    return (name, motion, seed, block, out)


def nominal_window(args):
    recipe, number, seed = args
    from rwa_monitor.diagnosis import adequacy
    rec = RECIPES[recipe]
    rng = np.random.default_rng([seed, number])
    wheel = rec.wheel(rng).model_copy(update={"name": f"{recipe}_{number:05d}"})
    scenario = rec.scenario(wheel, number, 1, rng)
    w = simulate(scenario, wheel, rng)
    (event,) = diagnose_samples(w.samples, wheel, built_in_model())
    d = event.diagnosis
    return (recipe, number, scenario.speed.kind, {n: l for n, l in w.truth.labels.items() if l}, adequacy.LAST, d.model_adequate, d.suspected_effect, d.verdict,
            {a.name: (a.active, a.probability) for a in d.anomalies})


def main() -> None:
    p = argparse.ArgumentParser()
    p.add_argument("--seeds", type=int, default=1)
    p.add_argument("--first", type=int, default=100)
    p.add_argument("--nominal", type=int, default=40)
    p.add_argument("--sigmas", type=float, default=0.5)
    p.add_argument("--windows", type=int, default=2)
    p.add_argument("--out", default="/tmp/rwa/adq/out.pkl")
    p.add_argument("--processes", type=int, default=2)
    o = p.parse_args()
    jobs = [(n, m, o.first + s, o.sigmas, o.windows) for n in EFFECTS for m in MOTIONS for s in range(o.seeds)]
    noms = [(r, i, o.first + 7) for r in ("paper", "mild", "hard", "derived") for i in range(o.nominal)]
    t = time.time()
    with multiprocessing.get_context("spawn").Pool(o.processes) as pool:
        nominal = pool.map(nominal_window, noms, chunksize=5)
        effects = pool.map(effect_windows, jobs, chunksize=3)
    pickle.dump((nominal, effects), open(o.out, "wb"))
    print(time.time() - t)


if __name__ == "__main__":
    main()
