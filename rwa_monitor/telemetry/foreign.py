"""Files that are nearly a CSV sample table: what they are instead, and what turns them into one.

Nothing is guessed and read: numbers with a comma in another place than meant are numbers all the same. The sentences
here only follow the reason why a table is refused.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from rwa_monitor.words import counted

# First bytes of what people give for a table, what it is, and what to do.
_SIGNATURES: Final[Sequence[tuple[bytes, str]]] = (
    (b"PK\x03\x04", "is a spreadsheet or another ZIP archive: save the sheet as CSV, or unpack the archive"),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "is a spreadsheet of an old format: save the sheet as CSV"),
    (b"\x1f\x8b", "is compressed (gzip): unpack it with gunzip"),
    (b"\x28\xb5\x2f\xfd", "is compressed (zstd): unpack it with unzstd"),
    (b"BZh", "is compressed (bzip2): unpack it with bunzip2"),
    (b"\xfd7zXZ\x00", "is compressed (xz): unpack it with unxz"),
    (b"\x89HDF\r\n\x1a\n", "is HDF5: export the columns as CSV or Parquet"),
    (b"MATLAB 5.0", "is a MATLAB file: export the columns as CSV"),
)
_NAMES: Final = {";": "semicolons", "\t": "tabs", "|": "bars"}
_COMMA_NUMBER: Final = re.compile(r"\s*[+-]?\d+,\d+([eE][+-]?\d+)?\s*")
_WHOLE: Final = re.compile(r"\s*[+-]?\d*([eE][+-]?\d+)?\s*")  # of a number that was cut at its decimal comma
_DATE: Final = re.compile(r"\s*\d{4}-\d\d?-\d\d?([T ].*)?|\s*\d\d?[./]\d\d?[./]\d{2,4}.*")
_COMMENT: Final = ("#", "%", "//")
_NO_TEXT: Final = re.compile(rb"[\x00-\x08\x0e-\x1a]")  # control characters that no text holds

COMMAS: Final = "write numbers with a decimal point, not a comma"


def kind_of(content: bytes) -> str:
    """Return what a file is by its first bytes, with what to do, "" where they show nothing."""
    return next((what for first, what in _SIGNATURES if content.startswith(first)), "")


def encoding_hint(content: bytes) -> str:
    """Return what to do about a text that is no UTF-8; content is not empty.

    With a byte order mark or a zero byte beside each letter it is UTF-16, with bytes that no text has it is none; else
    it is what a Western spreadsheet writes, which is reported as a guess.
    """
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return convert_from("utf-16")
    head = content[:1000]
    for encoding, zeros, letters in (("utf-16le", head[1::2], head[::2]), ("utf-16be", head[::2], head[1::2])):
        if any(letters) and zeros and not any(zeros):
            return f"perhaps UTF-16 without its mark; if so, {convert_from(encoding)}"
    if _NO_TEXT.search(head):
        return "this is no text at all: a table is CSV or Parquet, settings are TOML"
    return f"perhaps Latin-1 or Windows-1252; if so, {convert_from('windows-1252')}"


def convert_from(encoding: str) -> str:
    """Return the command that makes UTF-8 of a file."""
    return f"save it as UTF-8, or convert it: iconv -f {encoding} -t utf-8 FILE > NEW"


def separator_hint(header: str, first_rows: str) -> str:
    """Return what to do about a header whose columns are separated by something else than commas, "" where not."""
    counts = {separator: header.count(separator) for separator in _NAMES}
    separator = max(counts, key=lambda one: counts[one])
    if not counts[separator] or "," in header:
        return ""
    found = f"columns are separated by commas, and this row has {_NAMES[separator]}"
    written = "\\t" if separator == "\t" else separator
    if any(_COMMA_NUMBER.fullmatch(field) for row in first_rows.splitlines() for field in row.split(separator)):
        return f"{found}, and numbers with decimal commas; convert it: sed 's/,/./g; s/{written}/,/g' FILE > NEW"
    return f"{found}; convert it: sed 's/{written}/,/g' FILE > NEW"


def header_hint(names: Sequence[str]) -> str:
    """Return what is odd about the first row, where it names nothing: a comment, or numbers already; "" where not."""
    if names and names[0].startswith(_COMMENT):
        return "row 1 is a comment: remove it, the first row must name the columns"
    if names and all(_is_number(name) for name in names):
        return "row 1 holds numbers: the first row must name the columns"
    if names and names[0].startswith(("{", "[")):
        return "this looks like JSON: a table is CSV or Parquet"
    return ""


def oddities(head: str, wanted: Sequence[str]) -> list[tuple[str, str]]:
    """Return all that keeps a text from being a table, as its first rows show, for who wants to convert it only once.

    Parameters
    ----------
    head
        Its first rows.
    wanted
        Columns that it must have; "a or b" for one of two.

    Returns
    -------
    list of (word, phrase)
        A word that stands in the reason of a refusal for just this, and what is odd.
    """
    rows = head.splitlines()
    comments = next((k for k, row in enumerate(rows) if not row.lstrip().startswith(_COMMENT)), len(rows))
    found = [("comment", f"{counted(comments, 'row')} of comments")] if comments else []
    header, *values = rows[comments:] or [""]
    separator = "," if "," in header else max(_NAMES, key=header.count)
    if separator in header and separator != ",":
        found.append(("separated", f"{_NAMES[separator]} between the columns"))
    names = [name.strip().strip('"') for name in header.split(separator)]
    missing = [one for one in wanted if not any(known in names for known in one.split(" or "))]
    if missing:
        found.append(("is missing", f"no column {', no '.join(missing)}"))
    fields = [field.strip('"') for row in values for field in row.split(separator)]
    if any(_DATE.fullmatch(field) for field in fields):
        found.append(("a date", "dates instead of seconds"))
    if separator != "," and any(_COMMA_NUMBER.fullmatch(field) for field in fields):
        found.append(("decimal commas", "decimal commas"))
    return found


def fields_hint(row: str, expected: int) -> str:
    """Return why a row has so many fields, "" where nothing shows it."""
    fields = row.rstrip("\r\n").split(",")
    cut = expected < len(fields) <= 2 * expected and all(_WHOLE.fullmatch(field) for field in fields)
    return f"are these decimal commas? If so, {COMMAS}" if cut else ""


def number_hint(text: str) -> str:
    """Return what to do about a text that should be a number, "" where nothing shows it."""
    if _COMMA_NUMBER.fullmatch(text):
        return COMMAS
    if _DATE.fullmatch(text):
        return "this is a date: write seconds (time_s) or nanoseconds (time_ns) from any beginning"
    return ""


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
