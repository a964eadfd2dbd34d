"""Who does something on the page, and what there is to say of it."""

from __future__ import annotations

from typing import Final

from rwa_monitor.errors import InputError

MAX_NAME: Final = 100  # characters of a person's name
MAX_NOTE: Final = 2_000


def signed(person: str, note: str) -> tuple[str, str]:
    """Return name and note as they are kept.

    Raises
    ------
    InputError
        If the name is missing, or one of both too long.
    """
    person, note = person.strip(), note.strip()
    if not person or len(person) > MAX_NAME or len(note) > MAX_NOTE:
        raise InputError("name", f"is needed, of at most {MAX_NAME} characters, and a note of at most {MAX_NOTE}")
    return person, note
