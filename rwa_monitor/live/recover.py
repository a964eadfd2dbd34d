"""Saves what a cut or damaged recording still holds: every whole chunk, and only true messages."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Recovery:
    """What was saved and what was lost.

    Attributes
    ----------
    messages
        Messages saved.
    lost
        One line per part that could not be read; empty when the file was whole (exit code 0, otherwise 3).
    """

    messages: int
    lost: tuple[str, ...]


def recover(source: Path, target: Path) -> Recovery:
    """Copy what `source` still holds into a whole recording `target`.

    Raises
    ------
    InputError
        If `source` is no MCAP file at all, or `target` exists or is `source`.
    """
    raise NotImplementedError
