"""Candidates of the search that have no name in the catalogue: what they explain is told by its signature."""

from __future__ import annotations

from rwa_monitor.physics.effects.base import MeanEffect


class UnnamedEffect(MeanEffect):
    """A candidate that is no effect of the catalogue: no page describes it, and no wheel file can hold it.

    `name` only tells it from other candidates; `signature` is what a report says.
    """

    title = ""
    formula = ""
    description = ""
    source = ""
    separate_by = ""
