"""Replays recordings: the same core on the recorded inputs must give the recorded diagnoses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Report:
    """What a replay found.

    Attributes
    ----------
    files
        Recordings read, in chain order.
    compared
        Messages compared, by type name ("rwa.Diagnosis", "rwa.Changepoints").
    differences
        One line per difference beyond the tolerance; empty when all agree.
    bytes_equal
        True where every compared message has equal bytes.
    unreadable
        What could not be read of the files, in words; empty when whole.
    notes
        What a reader should know, such as "holds no whole window".
    messages
        The replayed outputs (topic, JSON bytes), in order.
    """

    files: tuple[Path, ...]
    compared: dict[str, int]
    differences: tuple[str, ...]
    bytes_equal: bool
    unreadable: tuple[str, ...]
    notes: tuple[str, ...]
    messages: tuple[tuple[str, bytes], ...]

    @property
    def equal(self) -> bool:
        """True when something was compared and nothing differs beyond 1e-9 relative."""
        return not self.differences and sum(self.compared.values()) > 0

    def short(self) -> str:
        """Return the short report: a few lines, differences counted per field."""
        raise NotImplementedError

    def long(self) -> str:
        """Return the long report: every difference."""
        raise NotImplementedError


def replay(recordings: Path | Sequence[Path]) -> Report:
    """Re-run the core on a recording (a file, a folder as a chain, or several files) and compare with what it holds.

    Exit codes on the command line: with --verify 1 unless `report.equal`; with --exact also unless
    `report.bytes_equal`; 3 where `report.unreadable` says something and the rest agrees.

    Raises
    ------
    InputError
        If a path is no recording, or its attachments cannot be used.
    """
    raise NotImplementedError


def replay_to_bus(recordings: Path | Sequence[Path], session: object, *, speed: float = 1.0) -> int:
    """Publish a recording's inputs on the bus again in the pace of their time (`replay --publish --speed X`)."""
    raise NotImplementedError
