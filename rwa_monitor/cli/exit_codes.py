"""The exit codes of the program; 0 is done."""

from __future__ import annotations

from typing import Final

FAILED: Final = 1  # or a check found a difference
WRONG_USE: Final = 2  # or bad input
UNREADABLE: Final = 3  # done, but bytes of the input could not be read
INTERRUPTED: Final = 130  # as a shell reports a program that SIGINT ended
