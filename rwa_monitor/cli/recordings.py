"""Recordings of one wheel, as the commands read them: what is left out is logged, what could not be read counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rwa_monitor.cli.console import log

if TYPE_CHECKING:
    from rwa_monitor.samples import Samples
    from rwa_monitor.telemetry.reader import Decoding
    from rwa_monitor.wheel.wheel import Wheel


@dataclass(frozen=True, slots=True)
class WheelRecordings:
    """Recordings of one wheel.

    Attributes
    ----------
    samples
        Name and samples of each file.
    wheel
        The first wheel that a file carries; None where none does.
    unreadable
        Whether bytes of a file could not be read.
    """

    samples: Sequence[tuple[str, Samples]]
    wheel: Wheel | None
    unreadable: bool


def with_motor_off(wheel: Wheel | None, *, motor_off: bool) -> Wheel | None:
    """Return the wheel with its motor off where that is asked for; a wheel of which nothing is known has no inertia.

    Raises
    ------
    InputError
        If it is asked for and no inertia is known.
    """
    from rwa_monitor.errors import InputError

    if not motor_off:
        return wheel
    if wheel is None or wheel.inertia_kg_m2 is None:
        raise InputError("--motor-off", "needs inertia_kg_m2 under [wheel] of the file given with --wheel")
    return wheel.model_copy(update={"friction": wheel.friction.model_copy(update={"motor_off": True})})


def read_recordings(files: Sequence[Path], decoding: Decoding) -> WheelRecordings:
    """Read files that are recordings of one wheel; with `decoding` where they do not name their channels.

    Raises
    ------
    InputError
        If a file cannot be used, or holds several wheels.
    """
    from rwa_monitor.monitor.telemetry_files import read_telemetry
    from rwa_monitor.telemetry.files import display_name
    from rwa_monitor.telemetry.reader import joined, only_wheel

    found: list[tuple[str, Samples]] = []
    wheel: Wheel | None = None
    unreadable = False
    for file in files:
        content = read_telemetry(file, decoding)
        log(*content.problems, *content.notes)
        unreadable |= bool(content.problems)
        telemetry = only_wheel(content, display_name(file))
        wheel = wheel or telemetry.constants
        found.append((str(file), joined(telemetry)))
    return WheelRecordings(found, wheel, unreadable)
