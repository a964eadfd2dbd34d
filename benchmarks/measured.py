"""What the search finds in measured friction: `python -m benchmarks.measured DIR -o docs/measured.md`.

DIR holds the six joints of a Stäubli TX40 (see `SOURCE`); the tables themselves are not part of this project. For each
joint: the basic law and the published parameters, the effects found by the search, and how much the effects found on
the first half of the record improve the prediction of the second half, where nothing is fitted.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.page import NONE, add_output_option, page, put_out, section, table
from rwa_monitor.discrepancy.explanation import prepare
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.likelihood import ACCEPT_GAIN, FIRST_GAIN
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.discrepancy.score import of_least_error
from rwa_monitor.discrepancy.terms import Model, make_term
from rwa_monitor.monitor.setup import read_wheel
from rwa_monitor.samples import FloatArray, Samples
from rwa_monitor.telemetry.table import read_table
from rwa_monitor.wheel.effects.catalogue import MEAN_EFFECTS
from rwa_monitor.wheel.wheel import Wheel

JOINTS: Final = (1, 2, 3, 4, 5, 6)
SOURCE: Final = (
    "figaroh-examples (thanhndv212/figaroh-examples, commit c0b5c7f0, Apache-2.0): measured motor position and torque "
    "of a TX40 robot; friction is motor torque less the rigid-body dynamics identified from the same record"
)
# Dry [N m], viscous [N m s/rad], offset [N m], as published with those data; joint 6 is coupled to joint 5.
PUBLISHED: Final = {
    1: (7.14, 8.05, 0.392),
    2: (8.26, 5.53, 1.37),
    3: (6.34, 1.97, 0.326),
    4: (2.48, 1.11, -0.102),
    5: (3.03, 1.86, -0.0288),
    6: (0.282, 0.65, 0.127),
}
NEAR_ZERO: Final = (0.02, 0.1)  # rad/s: beyond rest, where Stribeck friction would be largest
FAR: Final = (1.0, 3.0)  # rad/s
REVERSAL_S: Final = 0.05  # s about a change of sign: the friction was low-pass filtered at 50 Hz
MEMORY_S: Final = 0.5  # s over which residuals may correlate; 0.25 to 1 s change offsets' errors by a quarter at most

ABOUT: Final = """\
1,760 samples at 200 Hz a joint; samples at rest are left out. The tables are not part of this project;
`make measured MEASURED=DIR` writes this page from them, and `RWA_MEASURED_DATA` lets the tests look at them."""
ERRORS: Final = (
    "Dry, viscous and offset by least squares, ± one standard error that allows for residuals correlated over up to "
    f"{MEMORY_S:g} s (Newey and West)."
)
GAINS: Final = """\
Each from the basic law to the extended one. Held-out blocks: strengths fitted on every other block, levels afresh.
Second half: found and fitted on the first half, nothing fitted on the second; the level is the first half's mean."""
STRIBECK: Final = """\
- **Stribeck friction: no net rise seen in fast reversals, the quasi-static one not tested.** At
  {near_zero[0]:g}–{near_zero[1]:g} rad/s the drag lies below what the basic law gives, compared with
  {far[0]:g}–{far[1]:g} rad/s (N m, by joint: {near}).
  But these are {fewest} to {most} samples a joint, and {least:.0%} to {largest:.0%} of them lie within
  {reversal_ms:.0f} ms of a change of sign, in friction that came through a low-pass of 50 Hz: a rise that needs time to
  build, or that lasts a few samples, would not show. Slow, steady motion near zero was not measured, so that Stribeck
  friction is neither found nor excluded. What these data show, and the search names, is drag concave in the speed."""
OFFSET: Final = """\
- **Offsets** of the first table are named as `torque_bias` on joint 2 only, in one set with `coulomb_asymmetry`, from
  which one level cannot separate it. Two reasons. Residuals of the basic law are autocorrelated: with independent
  samples its errors would be {low:.1f} to {high:.1f} times smaller, and offsets of two standard errors would pass for
  seven (joints 1, 4 and 6). And an offset may stand in for what that law lacks. The next table adds `torque_bias` to
  the basic law and to the law that was found, levels and jumps found afresh each time: beside the effects found it
  gains less than the {accept:.0f} that are asked for: neither named nor excluded. On joint 1 one jump of the level
  within the first second takes its place (0.26 N m would remain without a jump), so that an offset is not excluded
  there."""
COLOUR: Final = """\
- **Coloured noise.** Where the last column of the second table is large, a slow wave and noise look alike. One
  likelihood decides, with the noise as an autoregression that is fitted anew under every candidate: effects that change
  faster than the noise's correlation time are separated from it (joint 3)."""
OFFSET_HEAD: Final = (
    "joint",
    "offset over its error",
    "over that of independent samples",
    "gain of `torque_bias` beside the basic law",
    "beside the law found",
    "its strength there [N m]",
)
JOINT_6: Final = """\
- **Joint 6** is coupled to joint 5, whose speed its table does not hold. A level that wanders stands for what is
  missing, and the report states that no effect explains it; effects named beside it may be stand-ins."""
ONE_RECORD: Final = "- One record a joint: what holds for both halves may still be this motion's."
LOAD: Final = """\
Friction on the motor torque as measured is friction on itself: the measured torque holds the friction that is to be
explained. Columns 3 and 4 are the RMSE with drag in proportion to the size of the motor torque over that of the basic
law: raw, and with the part of the torque that holds no measured friction (the rigid body's, and the fitted law). The
raw torque gains most where motor torque and friction are nearly the same; what is not friction in it gains nothing, so
that `load_dependence` is not named."""


@dataclass(frozen=True, slots=True)
class BasicLaw:
    """Dry and viscous friction and an offset fitted to a whole record, with standard errors and residuals."""

    values: FloatArray  # dry, viscous, offset
    std: FloatArray
    rmse_Nm: float
    near_zero_Nm: float  # mean residual along the motion at speeds NEAR_ZERO, less that at FAR
    near_zero_samples: int
    near_zero_reversing: float  # share of them within REVERSAL_S of a change of sign
    independent_std: FloatArray  # the standard errors under independent residuals


@dataclass(frozen=True, slots=True)
class Offset:
    """Gain of `torque_bias` added to a law (decrease of the penalised deviance), and its strength [N m]."""

    beside_basic: tuple[float, float]
    beside_found: tuple[float, float]


@dataclass(frozen=True, slots=True)
class SecondHalf:
    """RMSE on the second half of a record of models found and fitted on the first half [N m]."""

    names: tuple[str, ...]
    base_Nm: float
    extended_Nm: float


@dataclass(frozen=True, slots=True)
class Load:
    """RMSE over the basic law's with drag in proportion to the motor torque: as measured, and without the friction."""

    correlation: float  # of motor torque and friction
    raw_ratio: float
    clean_ratio: float
    clean_strength: float
    clean_std: float


@dataclass(frozen=True, slots=True)
class Joint:
    """All that is reported of one joint."""

    number: int
    basic: BasicLaw
    search: Search
    half: SecondHalf
    load: Load
    offset: Offset


def judge_joint(folder: Path, number: int) -> Joint:
    """Search one joint's record, and separately its first half.

    Raises
    ------
    InputError
        If the folder does not hold the tables.
    """
    wheel = read_wheel(folder / "wheel.toml")
    samples = read_table(folder / f"joint{number}.csv").samples
    search = find_discrepancy([(f"joint {number}", samples)], wheel)
    offset = Offset(bias_beside(search, search.base), bias_beside(search, search.extended))
    return Joint(number, basic_law(search), search, second_half(samples, wheel), load(search, samples), offset)


def basic_law(search: Search) -> BasicLaw:
    """Fit dry and viscous friction and an offset by least squares; errors allow for autocorrelated residuals."""
    problem = search.problem
    period = search.wheel.sample_period_s
    design = np.column_stack([np.ones(problem.size), problem.speed, problem.sign])
    values, residual, inverse = _least_squares(design, problem.z)
    scores = _covariance_of_scores(design * residual[:, None], round(MEMORY_S / period))
    std = np.sqrt(np.diag(inverse @ scores @ inverse))
    near, far = ((problem.speed >= low) & (problem.speed < high) for low, high in (NEAR_ZERO, FAR))
    turn = np.flatnonzero(problem.sign[1:] != problem.sign[:-1])
    beside = np.concatenate([problem.slot[turn], problem.slot[turn + 1]])  # rest may lie between the two
    to_turn = np.abs(problem.slot[near][:, None] - beside[None, :]).min(axis=1) * period
    return BasicLaw(
        values,
        std,
        _rms(residual),
        float(residual[near].mean() - residual[far].mean()),
        int(near.sum()),
        float(np.mean(to_turn <= REVERSAL_S)),
        np.sqrt(np.diag(inverse)) * _rms(residual),
    )


def _covariance_of_scores(scores: FloatArray, lags: int) -> FloatArray:
    """Return the covariance of the sum of scores correlated over `lags` samples, float64 (p, p).

    Bartlett weights: W. K. Newey, K. D. West, A simple, positive semi-definite, heteroskedasticity and
    autocorrelation consistent covariance matrix, Econometrica 55(3), 1987.
    """
    total = scores.T @ scores
    for lag in range(1, lags + 1):
        shifted = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (shifted + shifted.T)
    return np.asarray(total, dtype=np.float64)


def bias_beside(search: Search, model: Model) -> tuple[float, float]:
    """Return gain and strength [N m] of `torque_bias` added to a model, with levels and jumps estimated again."""
    fitting = Fitting(search.problem, jumps=bool(model.fit.jumps.size))
    alternatives = fitting.extensions(model, [MEAN_EFFECTS["torque_bias"]])
    if not alternatives:  # not worth a full fit
        return -search.problem.log_size, 0.0
    with_bias = alternatives[0]
    gain = model.score - with_bias.score
    return gain, float(with_bias.strengths(len(with_bias.terms) - 1)[0])


def second_half(samples: Samples, wheel: Wheel) -> SecondHalf:
    """Search the first half of a record and predict the second with what was found."""
    half = len(samples) // 2
    search = find_discrepancy([("first half", samples[slice(0, half)])], wheel)
    problem = prepare([make_record(samples, wheel, "whole")], wheel)  # whole: states (the angle, a lag) continue
    second = problem.slot >= half

    def rmse(model: Model) -> float:
        level = np.full(problem.size, float(np.mean(model.fit.level)))
        predicted = level + model.fit.coefficients[0] * problem.speed
        for index, term in enumerate(model.terms):
            columns = make_term(problem, term.effect, term.shape, level).columns
            predicted += columns @ model.strengths(index)
        return _rms((problem.z - predicted)[second])

    def least(model: Model) -> float:
        return min(rmse(model), rmse(of_least_error(search.problem, model)))

    return SecondHalf(search.extended.names, least(search.base), least(search.extended))


def load(search: Search, samples: Samples) -> Load:
    """Compare drag in proportion to the measured motor torque with drag in proportion to its part without friction."""
    problem = search.problem
    assert samples.motor_torque_Nm is not None
    assert samples.friction_torque_Nm is not None
    motor, friction = samples.motor_torque_Nm[problem.slot], samples.friction_torque_Nm[problem.slot]
    basic = np.column_stack([np.ones(problem.size), problem.speed, problem.sign])
    _, residual, _ = _least_squares(basic, problem.z)
    _, raw, _ = _least_squares(np.column_stack([basic, np.abs(motor)]), problem.z)
    clean = make_term(problem, MEAN_EFFECTS["load_dependence"], {}, search.base.fit.level).columns
    design = np.column_stack([basic, clean])
    values, rest, inverse = _least_squares(design, problem.z)
    return Load(
        float(np.corrcoef(motor, friction)[0, 1]),
        _rms(raw) / _rms(residual),
        _rms(rest) / _rms(residual),
        float(values[3]),
        float(np.sqrt(inverse[3, 3] * problem.noise.long_run_variance)),
    )


def to_markdown(joints: Sequence[Joint]) -> str:
    """Return docs/measured.md."""
    return page(
        "Measured friction: six joints of a robot",
        f"Source: {SOURCE}. {ABOUT}",
        section("The basic law beside the published parameters", ERRORS, _basic_table(joints)),
        section(
            "What it lacks",
            "Strongest first; in brackets what the data cannot separate from it.",
            table(
                [
                    "joint",
                    "mean effects",
                    "noise and jumps",
                    "unexplained",
                    "long-run over single variance of the noise",
                ],
                [[str(joint.number), *_lacking(joint.search)] for joint in joints],
            ),
            "Numbers behind the names are gains of the penalised deviance; "
            f"{FIRST_GAIN:.0f} is asked of the first, {ACCEPT_GAIN:.0f} of each further one.",
        ),
        section("What that gains", GAINS, _gain_table(joints)),
        *_remarks(joints),
    )


def _basic_table(joints: Sequence[Joint]) -> str:
    header = ["joint"]
    for name in ("dry [N m]", "viscous [N m s/rad]", "offset [N m]"):
        header += [name, "published"]
    rows = []
    for joint in joints:
        cells = [str(joint.number)]
        for value, std, known in zip(joint.basic.values, joint.basic.std, PUBLISHED[joint.number], strict=True):
            cells += [f"{value:.3g} ± {std:.2g}", f"{known:.3g}"]
        rows.append([*cells, f"{joint.basic.rmse_Nm:.3g}"])
    return table([*header, "RMSE [N m]"], rows)


def _lacking(search: Search) -> list[str]:
    """Return the cells of the search's results: mean effects, others, unexplained, autocorrelation of the noise."""
    effects, noise, left = search.result.effects, search.problem.noise, search.result.unexplained
    families: dict[bool, list[str]] = {True: [], False: []}
    for effect in effects:
        alike = f" ({', '.join(effect.equivalent)})" if effect.equivalent else ""
        families[effect.family == "mean"].append(f"`{effect.name}` {effect.delta_deviance:.0f}{alike}")
    return [
        "; ".join(families[True]),
        "; ".join(families[False]),
        "" if left is None else f"{left.signature}, {left.size_Nm:.2g} N m",
        f"{noise.long_run_variance / noise.std**2:.1f}",
    ]


def _gain_table(joints: Sequence[Joint]) -> str:
    def change(before_Nm: float, after_Nm: float) -> str:
        return f"{before_Nm:.3g} → {after_Nm:.3g} ({after_Nm / before_Nm - 1:+.0%})"

    rows = []
    for joint in joints:
        gain, half = joint.search.result.gain, joint.half
        assert gain is not None
        rows.append(
            [
                str(joint.number),
                change(gain.rmse_base_Nm, gain.rmse_extended_Nm),
                f"{gain.changepoints_base} → {gain.changepoints_extended}",
                ", ".join(half.names) or NONE,
                change(half.base_Nm, half.extended_Nm),
            ]
        )
    return table(["joint", "held out [N m]", "jumps", "found on the first half", "second half [N m]"], rows)


def _remarks(joints: Sequence[Joint]) -> list[str]:
    """Return the remarks that accompany the tables, with their figures."""
    times = [float(joint.basic.std[2] / joint.basic.independent_std[2]) for joint in joints]
    offset_rows = [
        [
            str(j.number),
            f"{abs(j.basic.values[2]) / j.basic.std[2]:.1f}",
            f"{abs(j.basic.values[2]) / j.basic.independent_std[2]:.1f}",
            f"{j.offset.beside_basic[0]:.0f}",
            f"{j.offset.beside_found[0]:.0f}",
            f"{j.offset.beside_found[1]:+.3f}",
        ]
        for j in joints
    ]
    load_rows = [
        [
            str(j.number),
            f"{j.load.correlation:.2f}",
            f"{j.load.raw_ratio:.3f}",
            f"{j.load.clean_ratio:.3f}",
            f"{j.load.clean_strength:.3f} ± {j.load.clean_std:.3f}",
        ]
        for j in joints
    ]
    stribeck = STRIBECK.format(
        near_zero=NEAR_ZERO,
        far=FAR,
        near=", ".join(f"{joint.number}: {joint.basic.near_zero_Nm:+.2f}" for joint in joints),
        fewest=min(joint.basic.near_zero_samples for joint in joints),
        most=max(joint.basic.near_zero_samples for joint in joints),
        least=min(joint.basic.near_zero_reversing for joint in joints),
        largest=max(joint.basic.near_zero_reversing for joint in joints),
        reversal_ms=1e3 * REVERSAL_S,
    )
    offset = OFFSET.format(low=min(times), high=max(times), accept=ACCEPT_GAIN)
    return [
        section(
            "What to make of it",
            "\n".join((stribeck, COLOUR, offset, JOINT_6, ONE_RECORD)),
            table(OFFSET_HEAD, offset_rows),
        ),
        section(
            "Load dependence",
            LOAD,
            table(
                ["joint", "correlation of motor torque and friction", "raw", "without friction", "strength [-]"],
                load_rows,
            ),
        ),
    ]


def _least_squares(design: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    inverse = np.linalg.pinv(design.T @ design, hermitian=True)
    values = inverse @ (design.T @ z)
    return values, z - design @ values, np.asarray(inverse, dtype=np.float64)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def main() -> None:
    """Judge the joints of a folder and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder that holds wheel.toml and joint1.csv … joint6.csv")
    add_output_option(parser)
    options = parser.parse_args()
    put_out(to_markdown([judge_joint(options.folder, number) for number in JOINTS]), options.output)


if __name__ == "__main__":
    main()
