"""XTCE definitions (CCSDS 660.1-G), read by `space_packet_parser`; what would take it without end is refused first."""

from __future__ import annotations

import warnings
from contextlib import redirect_stdout
from functools import cache, lru_cache
from io import BytesIO, StringIO
from typing import Any, Final

from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.telemetry.files import first_line
from rwa_monitor.telemetry.reader import TextFile

MAX_ENTRIES: Final = 10_000  # of a packet, with all containers in containers
MAX_DEPTH: Final = 50  # of containers in containers
MAX_EXPONENT: Final = 16  # of a polynomial calibrator


@cache
def parser_errors() -> tuple[type[Exception], ...]:
    """Return what the parser raises where a definition or a packet is not as it should be: it checks little itself."""
    from lxml import etree
    from space_packet_parser import exceptions

    return (
        ArithmeticError,
        AssertionError,
        AttributeError,
        LookupError,
        RuntimeError,  # a recursion without end among them
        TypeError,
        UserWarning,  # a length that does not agree
        ValueError,
        etree.LxmlError,
        exceptions.CalibrationError,
        exceptions.ComparisonError,
        exceptions.DynamicLengthBinaryParameterError,
        exceptions.ElementNotFoundError,
        exceptions.FormatStringError,
        exceptions.InvalidParameterTypeError,
        exceptions.UnrecognizedPacketTypeError,
    )


@lru_cache(maxsize=8)
def definition_of(file: TextFile) -> Any:
    """Return an XTCE definition, a `space_packet_parser.XtcePacketDefinition`.

    Raises
    ------
    InputError
        If it is none, is not plain (a document type could name other files and grow without end), or could make the
        parser work without end.
    """
    try:
        from lxml import etree
        from space_packet_parser import XtcePacketDefinition
    except ImportError as error:
        raise RwaMonitorError(f"{error.name} is missing: pip install 'rwa-monitor[ccsds]'") from error
    plain = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        root = etree.fromstring(file.text.encode("utf-8"), plain)
        if root.getroottree().docinfo.doctype:
            raise InputError(file.source, "has a document type (<!DOCTYPE …>), which no XTCE definition needs")
        _check_containers(root)
        with redirect_stdout(StringIO()), warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # no XTCE namespace
            definition = XtcePacketDefinition.from_xtce(BytesIO(etree.tostring(root)))
        _check_definition(definition)
    except parser_errors() as error:
        raise InputError(file.source, f"is no XTCE definition that can be used: {first_line(error)}") from error
    return definition


def _check_containers(root: Any) -> None:
    """Raise ValueError where containers hold each other or too much: thirty that hold the next twice are a billion."""
    entries = {
        container.get("name"): [entry.get("containerRef") for entry in container.iterfind("{*}EntryList/*")]
        for container in root.iterfind("{*}TelemetryMetaData/{*}ContainerSet/{*}SequenceContainer")
    }
    sizes: dict[str | None, int] = {}

    def size(name: str | None, above: tuple[str | None, ...]) -> int:
        if name in above or len(above) > MAX_DEPTH:
            raise ValueError(f"container {name} holds itself, or others more than {MAX_DEPTH} deep")
        if name not in sizes:
            sizes[name] = 1 + sum(size(inner, (*above, name)) if inner else 1 for inner in entries.get(name, []))
        return sizes[name]

    if sum(size(name, ()) for name in entries) > MAX_ENTRIES:
        raise ValueError(f"its containers hold more than {MAX_ENTRIES:,} entries")


def _check_definition(definition: Any) -> None:
    """Raise ValueError where parsing has no beginning, or a calibrator a power that takes long to reckon."""
    if definition.root_container_name not in definition.containers:
        raise ValueError(f"there is no container {definition.root_container_name}, where parsing begins")
    for kind in definition.parameter_types.values():
        context = getattr(kind.encoding, "context_calibrators", None) or ()
        calibrators = (getattr(kind.encoding, "default_calibrator", None), *(entry.calibrator for entry in context))
        for calibrator in calibrators:
            for term in getattr(calibrator, "coefficients", ()):
                if not 0 <= term.exponent <= MAX_EXPONENT:
                    raise ValueError(f"{kind.name}: a calibrator with exponent {term.exponent}")
