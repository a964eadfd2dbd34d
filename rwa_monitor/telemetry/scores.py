"""Event-wise scores of alarms against events in time, by the definitions of ESA's anomaly benchmark.

An event is an interval of time with an anomaly, [start, end]; an alarm one in which a detector reports it, [start,
end), and alarms that touch are merged. Several timelines, one for each wheel or recording, are scored together: counts
and times are summed, timing and affiliation are means over all events.

Sources: K. Kotowski et al., European Space Agency Benchmark for Anomaly Detection in Satellite Telemetry,
arXiv:2406.17826 (alarming precision; timing), with the correction of precision by M. E. Sehili and Z. Zhang,
arXiv:2308.13068; A. Huet et al., Local Evaluation of Time Series Anomaly Detection Algorithms, KDD 2022 (affiliation).
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from operator import itemgetter
from typing import Final, NamedTuple, Self, TypeVar

import numpy as np

from rwa_monitor.samples import FloatArray

Interval = tuple[int, int]  # start and end in ns
_Span = tuple[float, float]  # the same, relative to the start of its timeline
Time = TypeVar("Time", int, float)
_START, _END = itemgetter(0), itemgetter(1)

BETA: Final = 0.5  # of F: precision weighs twice as much as recall
# Affiliation precision of an event without an alarm in its zone: that of alarms at random times.
RANDOM_PRECISION: Final = 0.5
TIMING_EXPONENT: Final = math.e  # of the timing quality: a fifth of an event late still gives 0.98, a half 0.5


class Timeline(NamedTuple):
    """Time that was judged, [start_ns, end_ns), with the events and alarms in it, in any order.

    Parts outside of it do not count. Events may overlap: each is one to be detected.
    """

    start_ns: int
    end_ns: int
    events: Sequence[Interval] = ()
    alarms: Sequence[Interval] = ()

    @property
    def always(self) -> Self:
        """The same time and events with an alarm all the time."""
        return self._replace(alarms=[(self.start_ns, self.end_ns)])

    @property
    def never(self) -> Self:
        """The same time and events without an alarm."""
        return self._replace(alarms=())


@dataclass(frozen=True, slots=True)
class Scores:
    """Scores of the alarms of several timelines; None where there is nothing to judge by.

    Attributes
    ----------
    events, detected
        Events, and those that an alarm overlaps.
    false_alarms
        Alarms that overlap no event.
    redundant_alarms
        Alarms that overlap an event, beyond the first of each event.
    precision
        detected / (detected + false_alarms), times the share of the time without events that no alarm covers; 0
        without a detection.
    recall
        detected / events.
    f_0_5
        Of these two: 1.25 precision recall / (0.25 precision + recall).
    alarming_precision
        detected / (detected + redundant_alarms); 0 without a detection.
    timing
        Mean quality, 0 to 1, of the time at which the first alarm on each detected event begins: 1 at the event's
        start, 0 from its end on, and 0 its own length before the start, or at the start of the event before.
    timing_after
        Share of the detected events whose first alarm does not begin before them.
    affiliation_precision, affiliation_recall
        How near alarms are to the events, and events to the alarms, within the zone of times nearest to each event:
        probability that a time drawn there at random is farther away. Means over the events.
    affiliation_f_0_5
        Of these two.
    affiliation_recall_nearest
        The recall as its authors define it, from the nearest alarms; ESA's code differs where others precede these.
    """

    events: int
    detected: int
    false_alarms: int
    redundant_alarms: int
    precision: float
    recall: float | None
    f_0_5: float | None
    alarming_precision: float
    timing: float | None
    timing_after: float | None
    affiliation_precision: float | None
    affiliation_recall: float | None
    affiliation_f_0_5: float | None
    affiliation_recall_nearest: float | None


def score(timelines: Iterable[Timeline]) -> Scores:
    """Score the alarms of several timelines together; neither their order nor that of events and alarms matters."""
    found = [_judge(timeline) for timeline in timelines]
    alarms_on_events = [count for one in found for count in one.alarms_on_events]
    detected, false_alarms = sum(map(bool, alarms_on_events)), sum(one.false_alarms for one in found)
    redundant = sum(alarms_on_events) - detected
    nominal_ns = sum(one.nominal_ns for one in found)
    false_share = sum(one.false_ns for one in found) / nominal_ns if nominal_ns else 0.0
    precision = detected / (detected + false_alarms) * (1.0 - false_share) if detected else 0.0
    recall = _mean([float(count > 0) for count in alarms_on_events])
    timing = [pair for one in found for pair in one.timing]
    affiliation = [each for one in found for each in one.affiliation]
    near = [_mean([each[which] for each in affiliation]) for which in range(3)]
    return Scores(
        events=len(alarms_on_events),
        detected=detected,
        false_alarms=false_alarms,
        redundant_alarms=redundant,
        precision=precision,
        recall=recall,
        f_0_5=_f(precision, recall),
        alarming_precision=detected / (detected + redundant) if detected else 0.0,
        timing=_mean([quality for quality, _ in timing]),
        timing_after=_mean([float(is_after) for _, is_after in timing]),
        affiliation_precision=near[0],
        affiliation_recall=near[1],
        affiliation_f_0_5=_f(near[0], near[1]),
        affiliation_recall_nearest=near[2],
    )


def union(stretches: Iterable[tuple[Time, Time]], whole: tuple[Time, Time]) -> list[tuple[Time, Time]]:
    """Return the union of intervals within a whole as disjoint intervals in order; those that touch are merged."""
    joined: list[tuple[Time, Time]] = []
    for start, end in sorted((max(start, whole[0]), min(end, whole[1])) for start, end in stretches):
        if start >= end:
            continue
        if joined and start <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(end, joined[-1][1]))
        else:
            joined.append((start, end))
    return joined


class _Judged(NamedTuple):
    """Contribution of one timeline to the scores.

    Attributes
    ----------
    alarms_on_events
        For each event the number of alarms that overlap it.
    false_alarms
        Alarms that overlap none.
    nominal_ns, false_ns
        Time outside of events, and the part of it with an alarm.
    timing
        For each detected event the quality, and whether the alarm begins at the event's start or later.
    affiliation
        For each event precision, recall, and recall of the nearest alarms.
    """

    alarms_on_events: list[int]
    false_alarms: int
    nominal_ns: float
    false_ns: float
    timing: list[tuple[float, bool]]
    affiliation: list[tuple[float, float, float]]


def _judge(timeline: Timeline) -> _Judged:
    # Relative to its start: float64 cannot hold a clock's time to the nanosecond.
    whole = (0, timeline.end_ns - timeline.start_ns)
    given, raised = (
        [(start - timeline.start_ns, end - timeline.start_ns) for start, end in intervals]
        for intervals in (timeline.events, timeline.alarms)
    )
    events = sorted(chain.from_iterable(union([event], whole) for event in given))
    alarms, covered = union(raised, whole), union(events, whole)
    on_events = [_on(event, alarms) for event in events]
    on_any = [_on(event, alarms) for event in covered]
    middles = [(before[1] + after[0]) / 2 for before, after in pairwise(covered)]
    zones = list(pairwise([whole[0], *middles, whole[1]])) if covered else []
    near = [_affiliation(event, zone, _on(zone, alarms)) for event, zone in zip(covered, zones, strict=True)]
    return _Judged(
        alarms_on_events=[len(found) for found in on_events],
        false_alarms=len(alarms) - len(set(chain.from_iterable(on_any))),
        nominal_ns=_length([whole]) - _length(covered),
        false_ns=_length(alarms) - sum(_length(union(on, event)) for event, on in zip(covered, on_any, strict=True)),
        timing=[_timing(event, found[0], events) for event, found in zip(events, on_events, strict=True) if found],
        affiliation=[near[bisect_right(covered, start, key=_START) - 1] for start, _ in events],
    )


def _on(event: _Span, alarms: Sequence[_Span]) -> Sequence[_Span]:
    """Return which of the disjoint alarms, in order, overlap an event, whose end is part of it."""
    return alarms[bisect_right(alarms, event[0], key=_END) : bisect_right(alarms, event[1], key=_START)]


def _timing(event: _Span, alarm: _Span, events: Sequence[_Span]) -> tuple[float, bool]:
    """Return the quality of the time at which the first alarm on an event begins, and whether that is not before it."""
    start, end = event
    latency, length = alarm[0] - start, end - start
    if latency > 0:
        left = length - latency
        return (1.0 / (1.0 + (latency / left) ** TIMING_EXPONENT) if left else 0.0), True
    earlier = bisect_left(events, start, key=_START)  # events that start before this one
    reach = min(length, start - events[earlier - 1][0]) if earlier else length
    return max((latency + reach) / reach, 0.0) ** TIMING_EXPONENT, latency == 0


def _affiliation(event: _Span, zone: _Span, alarms: Sequence[_Span]) -> tuple[float, float, float]:
    """Return precision, recall and recall of the nearest alarms in an event's zone, the time that is nearest to it.

    Each is 1 less the mean probability that a time drawn at random from the zone is nearer: to the event than a time of
    an alarm is, to a time of the event than its alarm is.
    """
    alarms = union(alarms, zone)
    if not alarms:
        return RANDOM_PRECISION, 0.0, 0.0
    first, last = np.array(alarms, dtype=np.float64).T
    before, after = (_nearer_to(event, zone, np.maximum(event[0] - at, 0.0)) for at in (first, last))
    then, later = (_nearer_to(event, zone, np.maximum(at - event[1], 0.0)) for at in (first, last))
    precision = 1.0 - float((before - after + later - then).sum() / (last - first).sum())

    # Each part of the event belongs to the nearest alarm. ESA-ADB assigns the first part to the first alarm of the
    # zone, the second to the second, and so on, even where other alarms precede the nearest one.
    cells = list(pairwise([zone[0], *((last[:-1] + first[1:]) / 2).tolist(), zone[1]]))
    near = [k for k, (low, high) in enumerate(cells) if low <= event[1] and event[0] <= high]
    parts = [(max(event[0], cells[k][0]), min(event[1], cells[k][1])) for k in near]
    lost, lost_of_nearest = (
        sum(_nearer_than(alarms[k], part, zone) for k, part in zip(chosen, parts, strict=True)) / _length([event])
        for chosen in (range(len(near)), near)
    )
    return precision, 1.0 - lost, 1.0 - lost_of_nearest


def _nearer_to(event: _Span, zone: _Span, distance: FloatArray) -> FloatArray:
    """Integrate the probability that a random time is nearer to an event, over distances from it up to `distance`."""
    narrow = min(event[0] - zone[0], zone[1] - event[1])  # beyond it there is no more time on one side
    both = np.minimum(distance, narrow)
    area: FloatArray = _length([event]) * distance + (distance**2 + both**2) / 2 + narrow * (distance - both)
    return area / _length([zone])


def _nearer_than(alarm: _Span, part: _Span, zone: _Span) -> float:
    """Integrate over a part of an event the probability that a random time is nearer than the alarm."""
    (first, last), (low, high) = alarm, zone
    # The probability is piecewise linear with these nodes.
    time = np.unique(np.clip([*part, first, last, (first + low) / 2, (last + high) / 2], *part))
    distance = np.maximum(np.maximum(first - time, time - last), 0.0)
    share = (np.minimum(distance, time - low) + np.minimum(distance, high - time)) / _length([zone])
    return float(np.trapezoid(share, time))


# ---- arithmetic ------------------------------------------------------------------------------------------------------


def _length(stretches: Iterable[_Span]) -> float:
    return sum(end - start for start, end in stretches)


def _mean(values: Sequence[float]) -> float | None:
    return math.fsum(values) / len(values) if values else None


def _f(precision: float | None, recall: float | None) -> float | None:
    if precision is None or recall is None:
        return None
    weighed = BETA**2 * precision + recall
    return (1.0 + BETA**2) * precision * recall / weighed if weighed else 0.0
