"""What to fly next: the questions that a search leaves open, and the manoeuvres that would answer them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from rwa_monitor.discrepancy.finished_search import Search
from rwa_monitor.discrepancy.hypotheses import CANDIDATES
from rwa_monitor.discrepancy.likelihood import ACCEPT_GAIN
from rwa_monitor.discrepancy.plan import DECIDES, PlannedManoeuvre, rank_for_untested, rank_manoeuvres
from rwa_monitor.discrepancy.result import Unexplained
from rwa_monitor.discrepancy.untested import not_testable
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, MEAN_EFFECTS

UNINFORMATIVE: Final = 0.1  # nats: odds of 1.1 to 1
CERTAIN: Final = 2 * ACCEPT_GAIN  # an effect that gains so much needs no confirmation
# What would show the shape of something that no effect explains, by a word of its signature.
SHAPE_SHOWN_BY: Final = (
    (
        "wheel's angle",
        "sample fast while the wheel turns slowly, at two speeds: does the order stay? Compare the bearing's geometry",
    ),
    (
        "periodic",
        "dwell at one speed for ten of its periods or more, then at half that speed: is it time or the angle?",
    ),
    (
        "heat of the motion",
        "record the bearing's temperature; or hold top speed until the drag settles, then sweep slowly",
    ),
    (
        "since each reversal",
        "reverse, then run for thousands of turns at one speed, at two speeds: does it decay with turns or with time?",
    ),
    ("drift", "hold one speed and temperature for several windows: does it go on, settle, or follow the temperature?"),
    ("wander", "hold one speed and temperature for several windows: does it wander with nothing else changing?"),
    ("temperature", "hold one speed through a thermal cycle, then another speed: does it scale with the speed?"),
    ("dω/dt", "ramp at three accelerations, up and down, in both directions"),
    ("|speed|", "a ladder of dwells around the speeds where it shows, in both directions, up and down"),
)


@dataclass(frozen=True, slots=True)
class Plan:
    """What is open and what would answer it.

    Attributes
    ----------
    question
        What the manoeuvres are ranked by, in words.
    manoeuvres
        Best for its time first, without those that separate nothing; empty where none would help.
    advice
        What no manoeuvre of the library answers, in words.
    """

    question: str
    manoeuvres: list[PlannedManoeuvre]
    advice: list[str]


def plan(search: Search) -> Plan:
    """Rank the manoeuvres by how well they would answer the questions that are open.

    First the causes that the data cannot separate; else an effect that is not certain; else, or where no
    manoeuvre would confirm that, the effects that the data could not test.
    """
    advice = [] if search.result.unexplained is None else [_shown_by(search.result.unexplained)]
    mean = [effect for effect in search.result.effects if effect.name in MEAN_EFFECTS]
    sets = [
        [effect.name, *others]
        for effect in mean
        if (others := [name for name in effect.equivalent if name in MEAN_EFFECTS])
    ]
    uncertain = [[effect.name] for effect in mean if effect.delta_deviance < CERTAIN]
    if sets or uncertain:
        causes = (sets or uncertain)[0]
        manoeuvres = _worth_flying(rank_manoeuvres(search.problem, search.extended, causes, search.wheel))
        question = f"separate {' from '.join(causes)}" if sets else f"confirm {causes[0]}"
        if max((entry.separation for entry in manoeuvres), default=0.0) < DECIDES:
            would = dict.fromkeys(CATALOGUE[name].separate_by for name in causes)
            none = "none of these" if manoeuvres else "no manoeuvre of the library"
            advice.append(f"{none} would {question}; what would: {' '.join(would)}")
        if manoeuvres or sets:
            return Plan(question, manoeuvres, advice)
    untested = [name for name, _ in search.result.untested if name in MEAN_EFFECTS]
    # A manoeuvre does not measure what no channel measures.
    channels = not_testable(search.problem, CANDIDATES, search.result.untested)
    lacking = [name for name in untested if name in channels]
    untested = [name for name in untested if name not in channels]
    missing = dict(search.result.untested)
    for channel in dict.fromkeys(missing[name] for name in lacking):
        shown = ", ".join(name for name in lacking if missing[name] == channel)
        advice.append(f"no manoeuvre shows {shown} without {channel}")
    manoeuvres = _worth_flying(rank_for_untested(search.problem, search.extended, untested, search.wheel))
    if untested and not manoeuvres:
        advice.append("no manoeuvre of the library would show what these data could not test")
    if not manoeuvres and not advice:
        advice.append("nothing is open that a manoeuvre would answer")
    return Plan("show what these data could not test", manoeuvres, advice)


def _worth_flying(manoeuvres: list[PlannedManoeuvre]) -> list[PlannedManoeuvre]:
    """Return the manoeuvres that separate anything, in the order of how much in the same time: effects, then nats."""
    telling = [entry for entry in manoeuvres if entry.separation >= UNINFORMATIVE]
    return sorted(telling, key=lambda entry: (-len(entry.shows) / entry.duration_s, -entry.nats_per_hour))


def _shown_by(left: Unexplained) -> str:
    words = next((shown for word, shown in SHAPE_SHOWN_BY if word in left.signature), "the same manoeuvre again")
    return f"{left.signature}, that no effect explains: {words}"
