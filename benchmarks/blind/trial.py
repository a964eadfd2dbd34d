"""One blind trial: write the record, let the search answer from the files alone, then read the truth and judge."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.equivalence import accepted
from benchmarks.blind.generator import NOISE_EFFECTS, SWITCHING_EFFECTS, Case, Hidden, generate, orthogonal
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.jump_terms import JUMP_TERMS, DelayTerm
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.discrepancy.score import held_out
from rwa_monitor.discrepancy.shape_profile import middle_shape
from rwa_monitor.discrepancy.terms import Model, Term, make_term
from rwa_monitor.monitor.setup import read_wheel
from rwa_monitor.telemetry.table import read_table, write_csv
from rwa_monitor.wheel.effects.base import MeanEffect, NoiseEffect
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, MEAN_EFFECTS
from rwa_monitor.wheel.effects.jumps import SpeedTriggeredJumps
from rwa_monitor.wheel.effects.switching_base import Jumps, SwitchingEvidence

ACCEPTANCE = 25.0  # decrease of the criterion that the search requires (docs/theory.md, "Discrepancy search", 4)
TWICE_ACCEPTANCE = 2 * ACCEPTANCE
FORMULA = "formula"
SEARCHED = {**MEAN_EFFECTS, **{term.name: term for term in (DelayTerm, *JUMP_TERMS)}}

# Carrier and variable, in the grammar's terms, of the hidden laws that it can express.
GRAMMAR = {"bump": ("dry", "speed"), "even_bump": ("even", "speed"), "step_in_speed": ("dry", "speed")}


@dataclass(frozen=True)
class Outcome:
    """Results of a trial."""

    case: Case
    shapes: dict[str, dict[str, float]]
    oracle_gain: float  # of the weakest hidden effect; infinite where none is hidden
    verdict: str
    effects: list[dict[str, Any]]
    unexplained: str | None
    untested: list[str]
    jumps_base: int
    jumps_extended: int
    jumps_true: int
    jumps_oracle: int | None  # found by the same segmentation once the true torque is fitted
    gain: float  # held out, in nats over the record
    gain_torque: float | None  # the same of an oracle that is given the torque and the jumps, and fits the size
    gain_form: float | None  # of an oracle that is given name, shape and jumps, and uses the record's channels
    seconds: float  # of processor time
    estimates: dict[
        str, tuple[float, float]
    ]  # parameters of the hidden effects that were named: value and stated error
    law: str | None = None  # of the grammar, such as "formula dry*bump(speed)", where a formula was found

    def to_json(self) -> dict[str, Any]:
        return {**asdict(self), "kind": self.case.kind}

    @property
    def background(self) -> set[str]:
        """Noise effects of the case's own noise, in addition to the hidden effect: naming them is right."""
        return {"ar": {"coloured_noise"}, "student_t": {"heavy_tailed_noise"}}.get(self.case.noise, set())

    @property
    def named(self) -> list[dict[str, Any]]:
        """The effects named, strongest first, without `background` unless it is the hidden effect."""
        hidden = set(self.case.effects)
        return [e for e in self.effects if e["name"] in hidden or e["name"] not in self.background]

    @property
    def share_torque(self) -> float | None:
        """Return the held-out gain as a share of that of the oracle that is given the torque."""
        return _share(self.gain, self.gain_torque)

    @property
    def share_form(self) -> float | None:
        """Return the held-out gain as a share of that of the oracle that is given the form."""
        return _share(self.gain, self.gain_form)

    @property
    def testable(self) -> bool:
        return self.oracle_gain >= TWICE_ACCEPTANCE

    @property
    def first_right(self) -> bool:
        return bool(self.named) and self.named[0]["name"] in accepted(self.case.effects[0], self.case)

    @property
    def inside(self) -> bool:
        """Whether each hidden effect, or one that no such record distinguishes from it, is in a reported set."""
        return all(self.reported(name) for name in self.case.effects)

    def reported(self, name: str) -> bool:
        same = accepted(name, self.case)
        return any(same & {effect["name"], *effect["equivalent"]} for effect in self.named)

    @property
    def set_size(self) -> int | None:
        """Number of names in the set that holds the right answer, or in the first set where none does."""
        for effect in self.named:
            if accepted(self.case.effects[0], self.case) & {effect["name"], *effect["equivalent"]}:
                return 1 + len(effect["equivalent"])
        return 1 + len(self.named[0]["equivalent"]) if self.named else None

    @property
    def without_name(self) -> bool:
        """Whether something without a name was found: reported by the variable that it follows, or by a formula."""
        return self.unexplained is not None or any(effect["name"] == FORMULA for effect in self.effects)

    @property
    def law_is_right(self) -> bool:
        """Whether the formula has the carrier and the variable of the hidden law."""
        true = GRAMMAR[self.case.effects[0]]
        carrier, _, rest = (self.law or "").removeprefix("formula ").partition("*")
        return (carrier, rest.partition("(")[2].rstrip(")")) == true

    @property
    def false_names(self) -> list[str]:
        """Effects of any family that were named and are not in the record."""
        right = set().union(*(accepted(name, self.case) for name in self.case.effects)) if self.case.effects else set()
        right |= {FORMULA} if self.case.kind == "outside" else set()
        return [e["name"] for e in self.named if not right & {e["name"], *e["equivalent"]}]


def _share(gain: float, oracle: float | None) -> float | None:
    """Return the gain as a share of the oracle's; None where the oracle gains too little on held-out data."""
    return gain / oracle if oracle is not None and oracle > ACCEPTANCE else None


def run_trial(case: Case, folder: Path) -> Outcome:
    """Run one trial in a folder of its own."""
    samples, wheel, hidden = generate(case)
    table, wheel_file = folder / f"{case.seed}.csv", folder / f"{case.seed}.toml"
    write_csv(samples, table)
    wheel_file.write_text(wheel.to_toml())
    del samples, wheel
    search, answer, seconds = _answer(table, wheel_file)
    table.unlink()
    wheel_file.unlink()
    gain = answer["gain"]
    scores = search.scores
    oracles = held_out_oracles(search, hidden)
    return Outcome(
        case=case,
        shapes=hidden.shapes,
        oracle_gain=oracle_gain(search, hidden),
        verdict=answer["verdict"],
        effects=[{k: e[k] for k in ("name", "family", "equivalent", "delta_deviance")} for e in answer["effects"]],
        unexplained=None if answer["unexplained"] is None else answer["unexplained"]["signature"],
        untested=[entry["effect"] for entry in answer["untested"]],
        jumps_base=gain["changepoints_base"],
        jumps_extended=gain["changepoints_extended"],
        jumps_true=hidden.visible_jumps,
        jumps_oracle=oracles[0].fit.jumps.size if oracles else None,
        gain=(scores[-1].log_score - scores[0].log_score) * search.problem.size,
        gain_torque=_held_out_gain(search, oracles[0]) if oracles else None,
        gain_form=_held_out_gain(search, oracles[1]) if oracles else None,
        seconds=seconds,
        estimates={
            f"{e['name']}.{name}": (p["value"], p["std"])
            for e in answer["effects"]
            if e["name"] in case.effects
            for name, p in e["parameters"].items()
            if p["std"]
        },
        law=next((one.name for one in search.result.effects if one.formula), None),
    )


def _answer(table: Path, wheel_file: Path) -> tuple[Search, dict[str, Any], float]:
    """Return search, report and processor time [s] from the two files alone."""
    wheel = read_wheel(wheel_file)
    read = read_table(table)
    begin = time.process_time()
    search = find_discrepancy([("record", read.samples)], wheel)
    return search, search.result.to_json(), time.process_time() - begin


# ---- what an oracle would gain ---------------------------------------------------------------------------------------


def oracle_gain(search: Search, hidden: Hidden) -> float:
    """Return the gain of the true form, fitted given the true jumps; the smallest where several are hidden."""
    gains = []
    for name in hidden.case.effects:
        if name in hidden.torque:
            gains.append(_torque_gain(search.problem, hidden, name))
        elif name in NOISE_EFFECTS:
            gains.append(_noise_gain(search.problem, hidden, name))
        elif name in SWITCHING_EFFECTS:
            gains.append(_switching_gain(search, hidden, name))
    return min(gains, default=float("inf"))


def _torque_gain(problem: Problem, hidden: Hidden, name: str) -> float:
    """Least squares of the true column together with sign, speed and true levels; the true long-run variance."""
    parameters = 1 + max(len(hidden.shapes[name]) - 1, 0)
    column = orthogonal(np.sign(hidden.speed) * hidden.torque[name], np.abs(hidden.speed), hidden.jump_index)
    energy = float(column @ column)
    along = float(column @ (np.sign(hidden.speed) * hidden.residual)) / np.sqrt(energy)
    statistic = (np.sqrt(energy) + along) ** 2 / max(hidden.long_run_std, hidden.noise_std) ** 2
    return float(statistic - parameters * problem.log_size)


def _noise_gain(problem: Problem, hidden: Hidden, name: str) -> float:
    """The gain by the effect class's own likelihood, on the true noise."""
    effect = CATALOGUE[name]
    assert issubclass(effect, NoiseEffect)
    channels = problem.records[0].channels
    if name == "tachometer_quantisation":
        return float("inf")  # the quantisation is visible in the table itself
    return effect.fit(hidden.residual, channels, channels.good).penalised_gain


def _switching_gain(search: Search, hidden: Hidden, name: str) -> float:
    """The gain by the likelihood of a rate, given the true jumps; where attribution is needed, by a count of jumps."""
    channels = search.problem.records[0].channels
    size = hidden.level[hidden.jump_index] - hidden.level[hidden.jump_index - 1]
    if name in ("extra_switching_system", "wrong_duration_law"):
        # A sojourn that its law excludes costs log 50 (outliers have a probability of 1/50); a fitted law recovers
        # about half of it. The first and last sojourn of both systems are truncated by the record.
        return 2 * 0.5 * float(np.log(50.0)) * max(len(hidden.jump_index) - 4, 0)
    evidence = SwitchingEvidence(channels, channels.good, Jumps(hidden.jump_index, size))
    return SpeedTriggeredJumps.fit(evidence).penalised_gain


class _TrueForm(MeanEffect):
    """The hidden torque itself, as an effect whose strength is fitted."""

    name = "true_form"
    parameters = ()


def held_out_oracles(search: Search, hidden: Hidden) -> tuple[Model, Model] | None:
    """Return the fits of an oracle that is given the torque, and of one that is given its form; None without a torque.

    The first is given each hidden torque without sensor noise and fits its size: no search can reach it where an effect
    depends on a noisy channel. The second fits the catalogue's form to the record's channels, from the true shape.
    Both start from the true jumps.
    """
    if not hidden.torque:
        return None
    problem, jumps = search.problem, _true_jumps(search.problem, hidden)
    columns = np.stack([t[problem.slot] * problem.sign for t in hidden.torque.values()], axis=1)
    free = np.full(columns.shape[1], np.inf)
    fitting = Fitting(problem, jumps=True)
    base = fitting.base()
    torque = fitting.refitted((Term(_TrueForm, {}, columns, -free, free, len(_TrueForm.parameters)),), base, jumps)
    if not set(hidden.torque) <= SEARCHED.keys():
        return torque, torque
    level = hidden.level[problem.slot]
    terms = [make_term(problem, SEARCHED[name], _true_shape(problem, name, hidden), level) for name in hidden.torque]
    return torque, fitting.refitted(terms, base, jumps)


def _true_shape(problem: Problem, name: str, hidden: Hidden) -> dict[str, float]:
    """Return the drawn shape of an effect, with a middle value for each parameter that the generator does not have."""
    return {key: hidden.shapes[name].get(key, value) for key, value in middle_shape(problem, SEARCHED[name]).items()}


def _held_out_gain(search: Search, oracle: Model) -> float:
    problem = search.problem
    return float((held_out(problem, oracle).log_score - search.scores[0].log_score) * problem.size)


def _true_jumps(problem: Problem, hidden: Hidden) -> Sequence[np.ndarray[Any, np.dtype[np.int64]]]:
    at = np.searchsorted(problem.slot, hidden.jump_index)
    return [np.unique(at[(at > 0) & (at < problem.size)]).astype(np.int64)]
