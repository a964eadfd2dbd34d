"""What a ROS 2 message type may say, looked at before `mcap_ros2` takes it.

The decoder believes its types, and its parser has expressions that some text keeps busy without end. So a type is
checked line by line for what either would take longer over than the bytes are worth: names of constants that the parser
tries in all ways (24 letters: half a minute, and six times as long with two more), fields that need no bytes, more
objects than bytes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from rwa_monitor.errors import InputError

MAX_SCHEMA_BYTES: Final = 65_536
MAX_LINES: Final = 2_000  # the parser compares all names of a type with each other; large types have some hundred
MAX_LINE: Final = 1_000  # characters, without what follows a #
MAX_DEPTH: Final = 32  # of types in types
FEW_OBJECTS: Final = 64  # a message may have, however small it is

_COMMENT: Final = re.compile(r"#[^\n]*")
_SEPARATOR: Final = re.compile(r"={3,}")
_NAMED: Final = re.compile(r"MSG:\s+(\S+)")
# Bytes that the decoder takes without looking whether there are any: a list of such types would have no end.
_FIXED_BYTES: Final = re.compile(r"\s*(?:uint8|byte)\s*\[\s*([^\]\s<][^\]]*)\]")
# A field's type: its name, whether there are many, of any number, or how many.
_FIELD_TYPE: Final = re.compile(r"([^\[]*)(\[(?:(\]|<=)|([0-9]{1,9})\])?)?")
# In CDR, at least; a string begins with its length.
_BYTES: Final = {
    **dict.fromkeys(("bool", "byte", "char", "int8", "uint8"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32", "string", "wstring"), 4),
    **dict.fromkeys(("int64", "uint64", "float64"), 8),
}
_LENGTH_BYTES: Final = 4  # of a list of any length
_TIMES: Final = ("builtin_interfaces/Time", "builtin_interfaces/Duration")  # which the decoder knows
_CONSTANT: Final = re.compile(r"[A-Z][A-Z0-9]*(?:_[A-Z0-9]+)*")  # as ROS has it, in an expression without two ways


def checked_definition(name: str, data: bytes, source: str, place: str) -> bytes:
    """Return the definition of a type without its comments.

    Parameters
    ----------
    name
        Of the type, such as "sensor_msgs/msg/JointState".
    data
        Its definition and those of the types in it (`ros2msg`).
    source, place
        For messages: the bag, and the topic.

    Raises
    ------
    InputError
        If it exceeds a limit, or has what the decoder cannot be trusted with.
    """
    if len(data) > MAX_SCHEMA_BYTES:
        raise InputError(source, f"has a schema of more than {MAX_SCHEMA_BYTES:,} bytes", place)
    try:
        text = _COMMENT.sub("", data.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise InputError(source, f"{name} is no message type: {error}", place) from error
    lines = [line.replace("\t", " ").rstrip() for line in text.splitlines() if line.strip()]
    if len(lines) > MAX_LINES or max(map(len, lines), default=0) > MAX_LINE:
        reason = f"has a schema of more than {MAX_LINES:,} lines, or a line of more than {MAX_LINE:,} characters"
        raise InputError(source, reason, place)
    for line in lines:
        if _FIXED_BYTES.match(line):
            raise InputError(source, "has a field of a fixed number of bytes, which is not read here", place)
        if line.strip() == "MSG:":  # the parser would take the next line for its name
            raise InputError(source, f"{name} is no message type: MSG: names none", place)
        _, _, declared = line.partition(" ")
        if "=" in declared and not _CONSTANT.fullmatch(declared.partition("=")[0].strip()):
            raise InputError(source, f"{name} is no message type: {declared[:40]!r} names no constant", place)
    types = _Types(name, lines)
    try:
        whole = types.size_of(name)
        repeated = [types.size_of(kind) for kind in sorted(types.repeated)]
    except RecursionError as error:
        reason = f"has types in types, deeper than {MAX_DEPTH} levels, or a type that holds itself"
        raise InputError(source, reason, place) from error
    if any(size.objects > size.bytes for size in repeated) or whole.objects > max(whole.bytes, FEW_OBJECTS):
        raise InputError(source, "has a type of more objects than bytes, which is not read here", place)
    return text.encode()


class _Size(NamedTuple):
    """What the decoder makes of a type at least, its lists empty: objects, and the bytes that it takes for them."""

    objects: int
    bytes: int


class _Field(NamedTuple):
    """A field: its type, how often it is there at least, and the bytes that say how often."""

    kind: str
    times: int
    length_bytes: int = 0


class _Types:
    """The types of a definition, and how large they are at least.

    Attributes
    ----------
    repeated
        Types of which there are many in a field.
    """

    def __init__(self, name: str, lines: list[str]) -> None:
        self.repeated: set[str] = set()
        self._fields: dict[str, list[_Field]] = {}
        for kind, within in _sections(name, lines):
            package = kind.split("/")[0]
            fields = [self._field(line, package) for line in within if "=" not in line.partition(" ")[2]]
            # As the parser does: of two types of one name the last one counts, and a name goes with and without "msg".
            self._fields[kind] = self._fields[f"{package}/{kind.split('/')[-1]}"] = fields
        known = {kind: _Size(1, 8) for kind in _TIMES if kind not in self._fields}
        self._sizes = known | {kind: _Size(0, size) for kind, size in _BYTES.items()}

    def _field(self, line: str, package: str) -> _Field:
        found = _FIELD_TYPE.match(line.partition(" ")[0])
        assert found is not None  # it matches anything
        kind, many, of_any_number, count = found.groups()
        kind = kind.partition("<")[0]  # of a string no longer than so
        if kind not in _BYTES and "/" not in kind:
            kind = f"{package}/{kind}"
        if many is None:
            return _Field(kind, 1)
        self.repeated.add(kind)
        return _Field(kind, 0, _LENGTH_BYTES) if of_any_number else _Field(kind, int(count or 0))

    def size_of(self, kind: str, depth: int = 0) -> _Size:
        """Return the size of a type; raises RecursionError where types lie too deep in types."""
        if depth > MAX_DEPTH:
            raise RecursionError
        if kind not in self._sizes:
            fields = self._fields.get(kind, [])
            sizes = [self.size_of(field.kind, depth + 1) for field in fields]
            objects = sum(field.times * size.objects for field, size in zip(fields, sizes, strict=True))
            taken = sum(
                field.length_bytes + field.times * size.bytes for field, size in zip(fields, sizes, strict=True)
            )
            self._sizes[kind] = _Size(1 + objects, taken if fields else 1)  # one without fields has a byte
        return self._sizes[kind]


def _sections(name: str, lines: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield each type by its name, with its lines."""
    within: list[str] = []
    for line in [*lines, "==="]:
        if not _SEPARATOR.fullmatch(line):
            within.append(line)
            continue
        if within and (named := _NAMED.fullmatch(within[0].strip())):
            name = named[1]
        yield name, [of for of in within if not _NAMED.fullmatch(of.strip())]
        within = []
