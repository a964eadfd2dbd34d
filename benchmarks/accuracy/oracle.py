"""Oracles: methods that are given part of the truth, to separate a method's errors from the limits of the data.

Oracle A is given the true components and configurations. Oracle B is given when each system jumped, and estimates the
rest from the samples: friction, and where fewer configurations of a system occur than it has, which ones these are.

Oracle C concerns changepoints: it is given the jumps, the noise and the slope, and has to find the exact place of each
jump and the system that made it. No search that is given laws, noise and slope can place and assign more.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.window import window_of
from rwa_monitor.changepoints.estimation import estimate
from rwa_monitor.changepoints.running_sums import RunningSums
from rwa_monitor.changepoints.stage_results import Assignment, Candidates, NoiseEstimate
from rwa_monitor.diagnosis.features import Features, SystemFeatures, features_of
from rwa_monitor.diagnosis.findings import changepoints_of
from rwa_monitor.kernels.changepoints import refine_in_colour
from rwa_monitor.messages import AttributedChangepoint
from rwa_monitor.samples import IntArray
from rwa_monitor.simulation.datasets import LabelledWindow
from rwa_monitor.simulation.record import Truth
from rwa_monitor.switching.assignment import assign
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.switching.components import split

ORACLE_SCALE = 8  # slots: the assignment moves a candidate by half of this at most


def true_sojourns(truth: Truth, s: int, name: str) -> tuple[IntArray, IntArray]:
    """Return the first slot and the configuration of each sojourn of a system, int64 (sojourns,)."""
    jumps = truth.changepoints
    starts = np.concatenate([[0], jumps.index[jumps.system == s]]).astype(np.int64)
    return starts, truth.configuration[name][starts].astype(np.int64)


def features_of_truth(window: LabelledWindow) -> Features:
    """Return the features of oracle A: true coefficients, with the standard deviation of an ideal estimate."""
    truth, wheel = window.telemetry.truth, window.wheel
    assert wheel.nominal is not None  # recipes have complete wheels
    unit = wheel.torque_unit_Nm
    noise = truth.noise_std_Nm / unit
    systems = []
    for s, system in enumerate(wheel.fss):
        starts, configuration = true_sojourns(truth, s, system.name)
        lengths = np.diff(np.append(starts, truth.used.size))
        systems.append(
            SystemFeatures(
                system.name,
                configuration,
                truth.fss_friction_Nm[system.name][starts] / unit,
                noise / np.sqrt(np.maximum(lengths, 1)),
                rests=bool((configuration == 0).any()),
            )
        )
    root = float(np.sqrt(max(int(truth.used.sum()), 1)))
    return Features(
        base_dry=float(np.mean(truth.base_dry_Nm)) / unit,
        base_dry_std=noise / root,
        viscous=float(np.mean(truth.viscous_Nm_s_rad)) / wheel.nominal.viscous_Nm_s_rad,
        viscous_std=noise / root,
        systems=tuple(systems),
    )


def features_with_true_jumps(window: LabelledWindow) -> Features:
    """Return the features of oracle B: the stages' own estimates, given the true changepoints and systems."""
    truth, wheel = window.telemetry.truth, window.wheel
    evidence = window_of(window).evidence()
    jumps = truth.changepoints
    index, system = jumps.index, jumps.system
    places = np.unique(index)
    estimated = estimate(evidence, places)
    unit = wheel.torque_unit_Nm
    sojourns = [true_sojourns(truth, s, each.name) for s, each in enumerate(wheel.fss)]
    level_std = np.hypot(estimated.level_std[:-1], estimated.level_std[1:])
    assignment = Assignment(
        index=index,
        system=system,
        direction=np.sign(jumps.jump_Nm).astype(np.int64),
        jump=jumps.jump_Nm / unit,
        jump_std=level_std[np.searchsorted(places, index)],
        confidence=np.ones(index.size),
        configurations=tuple(configuration for _, configuration in sojourns),
        starts=tuple(starts for starts, _ in sojourns),
        log_score=0.0,
        states=0,
        pruned=False,
    )
    components = split(assignment, estimated, evidence, wheel, CarriedState.empty())
    if components.by_path:  # sorted: the path most likely under broad friction laws comes first
        path = components.by_path[0].path
        assignment = replace(assignment, configurations=path.split(path.configurations))
        components = split(assignment, estimated, evidence, wheel, CarriedState.empty())
    return features_of(components, assignment, wheel)


def jumps_of_ideal_search(window: LabelledWindow) -> list[AttributedChangepoint]:
    """Return the changepoints of oracle C: the true jumps, each at its most likely place, assigned by the laws.

    The likelihood of a place is that of AR(1) noise whose coefficient is known.
    """
    truth, wheel = window.telemetry.truth, window.wheel
    evidence = window_of(window).evidence()
    unit = wheel.torque_unit_Nm
    colour = (window.scenario.noise.ar_coefficient or 0.0) if window.scenario.noise.law == "ar1" else 0.0
    lags = np.arange(evidence.noise.autocovariance.size)
    noise = NoiseEstimate(
        std=truth.noise_std_Nm / unit,
        autocovariance=(truth.noise_std_Nm / unit) ** 2 * np.where(lags > 0, colour**lags, 1.0),
        long_run_factor=(truth.long_run_std_Nm / truth.noise_std_Nm) ** 2,
    )
    places, size = np.unique(truth.changepoints.index), evidence.slots
    borders = np.concatenate([[0], places, [size]])
    sums, slope = evidence.sums, float(np.mean(truth.viscous_Nm_s_rad)) * wheel.speed_unit_rad_s / unit
    assert isinstance(sums, RunningSums)
    found = []
    for low, place, high in zip(borders[:-2], places, borders[2:], strict=True):
        reach = int(max(min(place - low, high - place) // 2, 1))
        found.append(refine_in_colour(int(place), int(low), int(high), reach, slope, colour, sums.arrays))
    index = np.unique(np.array(found, dtype=np.int64))
    borders = np.concatenate([[0], index, [size]])
    n, x, z = evidence.sums.between(borders[:-1], borders[1:])[:3]
    with np.errstate(invalid="ignore", divide="ignore"):
        jump = np.diff((z - slope * x) / n)
        each = noise.std**2 * noise.long_run_factor / n
    statistic = np.nan_to_num(jump**2 / (each[:-1] + each[1:]))
    candidates = Candidates(index, np.full(index.size, ORACLE_SCALE), statistic, jump)
    assignment, _ = assign(evidence._replace(candidates=candidates, noise=noise), wheel)
    # A place without any sample on one side gives no estimate of the jump: NaN becomes 0.
    return changepoints_of(replace(assignment, jump=np.nan_to_num(assignment.jump)), wheel)
