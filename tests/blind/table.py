"""The table of the blind suite: issue 3's targets beside what was measured, with intervals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from scipy import stats

from rwa_monitor.physics.effects.catalogue import CATALOGUE
from tests.blind.trial import Outcome


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a rate (Wilson 1927)."""
    if count == 0:
        return 0.0, 1.0
    interval = stats.binomtest(hits, count).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def rate(outcomes: Iterable[Outcome], hit: Callable[[Outcome], bool]) -> str:
    """Return "hits/count = share % (low–high)"."""
    judged = [hit(outcome) for outcome in outcomes]
    if not judged:
        return "no record"
    low, high = wilson(sum(judged), len(judged))
    share = 100 * sum(judged) / len(judged)
    return f"{share:.1f} % ({100 * low:.0f}–{100 * high:.0f} %), {sum(judged)} of {len(judged)}"


def real_names(outcome: Outcome) -> list[str]:
    """The names given in a record that hides nothing but noise: mean and switching effects only."""
    return [name for name in outcome.false_names if CATALOGUE[name].family != "noise"]


def report(outcomes: Sequence[Outcome], seed: int) -> str:
    """Return the table as Markdown."""
    one = [o for o in outcomes if o.case.kind == "one"]
    weak = [o for o in one if not o.testable]
    one = [o for o in one if o.testable]
    mean = [o for o in one if CATALOGUE[o.case.effects[0]].family == "mean"]
    noise = [o for o in one if CATALOGUE[o.case.effects[0]].family == "noise"]
    switching = [o for o in one if CATALOGUE[o.case.effects[0]].family == "switching"]
    nulls = [o for o in outcomes if o.case.kind == "null"]
    two = [o for o in outcomes if o.case.kind == "two" and o.testable]
    outside = [o for o in outcomes if o.case.kind == "outside" and o.testable]
    strong = [o for o in one if o.gain_share is not None and o.case.strength >= 0.5]
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
        ("nothing hidden, but something unexplained said", "", rate(nulls, lambda o: o.unexplained is not None)),
        (
            "noise that is there, named",
            "",
            rate([o for o in nulls if o.background], lambda o: o.background <= {e["name"] for e in o.effects}),
        ),
        ("two effects, both found", "≥ 88 %", rate(two, lambda o: o.inside)),
        ("outside the catalogue: verdict inadequate", "≥ 90 %", rate(outside, lambda o: o.verdict == "inadequate")),
        ("outside the catalogue: unexplained said", "≥ 80 %", rate(outside, lambda o: o.unexplained is not None)),
        ("outside the catalogue: a wrong name", "≤ 10 %", rate(outside, lambda o: bool(real_names(o)))),
        (
            "held-out gain at least 95 % of an oracle's, ≥ 0.5 σ",
            "share ≥ 95 %",
            rate(strong, lambda o: (o.gain_share or 0) >= 0.95),
        ),
        (
            "jumps after extension within 1 of the truth",
            "≥ 90 %",
            rate(mean, lambda o: abs(o.jumps_extended - o.jumps_true) <= 1),
        ),
    ]
    if strong:
        shares = sorted(o.gain_share or 0.0 for o in strong)
        rows.insert(-1, ("— median share", "", f"{100 * shares[len(shares) // 2]:.1f} %"))
    times = sorted(o.seconds for o in outcomes)
    lines = [
        "# The blind suite",
        "",
        f"{len(outcomes)} records of 20,000 samples, seed {seed}; rates with 95 % intervals (Wilson). Written by",
        "`python -m tests.blind.suite`; what is hidden, and what counts as the same answer, stands in `tests/blind/`.",
        "",
        "| | target | measured |",
        "|---|---|---|",
        *(f"| {name} | {target} | {value} |" for name, target, value in rows),
        "",
        f"Apart: {len(weak)} records in which an oracle (true form, true jumps) gains less than twice the acceptance",
        f"threshold; the cause is inside the reported set in {rate(weak, lambda o: o.inside)}.",
        "",
        "| hidden | records | right first | inside the set | what was said first otherwise |",
        "|---|---|---|---|---|",
        *_by_effect(one),
        "",
        f"Time of a search: median {times[len(times) // 2]:.1f} s, longest {times[-1]:.1f} s, on a shared machine.",
        "",
    ]
    return "\n".join(lines)


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
