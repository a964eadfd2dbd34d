"""The table of the blind suite: issue 3's targets and the measured figures, with intervals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import numpy as np
from scipy import stats

from benchmarks.blind.trial import FORMULA, GRAMMAR, Outcome
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, MEAN_EFFECTS


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a rate (Wilson 1927)."""
    if count == 0:
        return 0.0, 1.0
    interval = stats.binomtest(hits, count).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


Judged = TypeVar("Judged")


def rate(outcomes: Iterable[Judged], hit: Callable[[Judged], bool]) -> str:
    """Return "hits/count = share % (low–high)"."""
    judged = [hit(outcome) for outcome in outcomes]
    if not judged:
        return "no record"
    low, high = wilson(sum(judged), len(judged))
    share = 100 * sum(judged) / len(judged)
    return f"{share:.1f} % ({100 * low:.0f}–{100 * high:.0f} %), {sum(judged)} of {len(judged)}"


# Effects with one strength that generator and catalogue define in the same way; B is the generator's parameter name.
COMPARED = {name for name, effect in MEAN_EFFECTS.items() if len(effect.strength_parameters()) == 1} | {"decaying_jump"}
TEMPERATURE_OF_VISCOSITY = "B"
WIDTH_95 = 1.96  # standard deviations


def intervals(outcome: Outcome) -> list[bool]:
    """Return for each estimated parameter of effects in `COMPARED` whether its 95 % interval covers the true value."""
    inside = []
    for key, (value, std) in outcome.estimates.items():
        name, parameter = key.split(".")
        if name in COMPARED:
            truth = outcome.shapes[name]
            is_strength = any(parameter == one.name for one in CATALOGUE[name].parameters if one.linear)
            of_all = "strength" if is_strength else TEMPERATURE_OF_VISCOSITY
            true_value = truth[parameter] if parameter in truth else truth[of_all]
            inside.append(abs(value - true_value) <= WIDTH_95 * std)
    return inside


def real_names(outcome: Outcome) -> list[str]:
    """Return the false names of a record without those of noise effects: mean and switching effects, and formulas."""
    return [name for name in outcome.false_names if name == FORMULA or CATALOGUE[name].family != "noise"]


def report(outcomes: Sequence[Outcome], seed: int, planned: int) -> str:
    """Return the table as Markdown; `planned` is the number of records of the full plan."""
    one = [o for o in outcomes if o.case.kind == "one"]
    weak = [o for o in one if not o.testable]
    one = [o for o in one if o.testable]
    mean = [o for o in one if CATALOGUE[o.case.effects[0]].family == "mean"]
    noise = [o for o in one if CATALOGUE[o.case.effects[0]].family == "noise"]
    switching = [o for o in one if CATALOGUE[o.case.effects[0]].family == "switching"]
    nulls = [o for o in outcomes if o.case.kind == "null"]
    two = [o for o in outcomes if o.case.kind == "two" and o.testable]
    outside = [o for o in outcomes if o.case.kind == "outside" and o.testable]
    strong = [o for o in one if o.case.strength >= 0.5]
    by_form = [o for o in strong if o.share_form is not None]
    by_torque = [o for o in strong if o.share_torque is not None]
    sizes = [o.set_size for o in one if o.set_size is not None]
    of = {m: [o for o in one if o.case.manoeuvre == m] for m in ("one_direction", "crossings", "rich")}
    rows = [
        ("right cause first, rich", "≥ 97 %", rate(of["rich"], lambda o: o.first_right)),
        ("right cause first, crossings", "≥ 92 %", rate(of["crossings"], lambda o: o.first_right)),
        ("right cause first, one direction", "", rate(of["one_direction"], lambda o: o.first_right)),
        ("— mean effects, all manoeuvres", "", rate(mean, lambda o: o.first_right)),
        ("— noise effects", "", rate(noise, lambda o: o.first_right)),
        ("— switching effects", "", rate(switching, lambda o: o.first_right)),
        ("true cause inside the reported set", "≥ 98 %", rate(one, lambda o: o.inside)),
        ("mean size of that set", "≤ 3", f"{sum(sizes) / max(len(sizes), 1):.2f}"),
        ("nothing hidden, but a mean or switching effect named", "≤ 2 %", rate(nulls, lambda o: bool(real_names(o)))),
        (
            "nothing hidden, but a noise effect named that is not there",
            "",
            rate(nulls, lambda o: bool(set(o.false_names) - set(real_names(o)))),
        ),
        ("nothing hidden, but something without a name reported", "", rate(nulls, lambda o: o.without_name)),
        (
            "noise that is there, named",
            "",
            rate([o for o in nulls if o.background], lambda o: o.background <= {e["name"] for e in o.effects}),
        ),
        ("two effects, both found", "≥ 88 %", rate(two, lambda o: o.inside)),
        ("outside the catalogue: verdict inadequate", "≥ 90 %", rate(outside, lambda o: o.verdict == "inadequate")),
        ("outside the catalogue: unexplained, or a formula", "≥ 95 %", rate(outside, lambda o: o.without_name)),
        (
            "— of those that the grammar can express: a formula of the right carrier and variable",
            "≥ 60 %",
            rate([o for o in outside if o.case.effects[0] in GRAMMAR], lambda o: o.law_is_right),
        ),
        ("outside the catalogue: a wrong name", "≤ 10 %", rate(outside, lambda o: bool(real_names(o)))),
        (
            "parameters whose stated 95 % interval holds the truth",
            "90–98 %",
            rate([hit for o in (*one, *two) for hit in intervals(o)], bool),
        ),
        *_shares("that is given name, shape and jumps", "≥ 95 %", [(o.gain, o.gain_form or 0.0) for o in by_form]),
        *_shares("that is given the torque itself", "", [(o.gain, o.gain_torque or 0.0) for o in by_torque]),
        (
            "jumps after extension within 1 of the truth",
            "≥ 90 %",
            rate(mean, lambda o: abs(o.jumps_extended - o.jumps_true) <= 1),
        ),
        (
            "— within 1 of those found once the true torque is fitted",
            "",
            rate(mean, lambda o: o.jumps_oracle is not None and abs(o.jumps_extended - o.jumps_oracle) <= 1),
        ),
    ]
    times = sorted(o.seconds for o in outcomes)
    lines = [
        "# The blind suite",
        "",
        f"{len(outcomes)} of the {planned} records of the plan, 20,000 samples each, seed {seed}; rates with 95 %",
        "intervals (Wilson). Written by `python -m benchmarks.blind.suite`; what is hidden, and what counts as the",
        "same answer, stands in `benchmarks/blind/`. Any first part of the plan is balanced over what is hidden.",
        "",
        "| | target | measured |",
        "|---|---|---|",
        *(f"| {name} | {target} | {value} |" for name, target, value in rows),
        "",
        f"Apart: {len(weak)} records in which an oracle (true form, true jumps) gains less than twice the acceptance",
        f"threshold; the cause is inside the reported set in {rate(weak, lambda o: o.inside)}.",
        "",
        "| hidden | records | right first | inside the set | what was named first otherwise |",
        "|---|---|---|---|---|",
        *_by_effect(one),
        "",
        f"Processor time of a search: median {times[len(times) // 2]:.1f} s, longest {times[-1]:.1f} s.",
        "",
    ]
    return "\n".join(lines)


def _shares(who: str, target: str, gains: Sequence[tuple[float, float]]) -> list[tuple[str, str, str]]:
    """Return the rows on held-out gains as shares of an oracle's, by record and summed over records."""
    if not gains:
        return [(f"held-out gain of an oracle's {who}, ≥ 0.5 σ", target, "no record")]
    shares = np.array([own / oracle for own, oracle in gains])
    half = 1.96 * float(np.std(shares, ddof=1)) / np.sqrt(shares.size) if shares.size > 1 else float("nan")
    own, oracle = np.sum(np.array(gains), axis=0)
    return [
        (
            f"share of the held-out gain of an oracle {who}, ≥ 0.5 σ: mean over records",
            target,
            f"{100 * shares.mean():.1f} % (± {100 * half:.1f}), {shares.size} records",
        ),
        ("— of the summed gains", "", f"{100 * own / oracle:.1f} %"),
        ("— median record", "", f"{100 * float(np.median(shares)):.1f} %"),
        ("— records that reach 95 %", "", rate(shares.tolist(), lambda share: share >= 0.95)),
    ]


def _by_effect(one: Sequence[Outcome]) -> list[str]:
    lines = []
    for name in CATALOGUE:
        those = [o for o in one if o.case.effects[0] == name]
        if not those:
            continue
        wrong = Counter(
            o.named[0]["name"] if o.named else o.unexplained or "nothing" for o in those if not o.first_right
        )
        said = ", ".join(f"{what} ×{count}" for what, count in wrong.most_common())
        right, inside = sum(o.first_right for o in those), sum(o.inside for o in those)
        lines.append(f"| {name} | {len(those)} | {right} | {inside} | {said} |")
    return lines
