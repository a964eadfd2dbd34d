"""A wheel in Foxglove: the messages of the bus as they are, and additional messages that its panels need.

Samples come in arrays, but a plot needs one message for each: {key}/telemetry. Jumps happen before the message that
reports them: {key}/jump has them at their own time. The parts of friction are a map in the diagnosis: each is a topic
here, {key}/part/{name}. Messages to the operator are lines of {key}/log, in Foxglove's own schema for its log panel.
All times are the wheel's own clock.

Recordings keep the published schemas. Foxglove's reader of JSON Schema takes objects, arrays and plain types, but no
$ref, no anyOf and no maps (foxglove/studio, packages/mcap-support/src/parseJsonSchema.ts), and rejects a topic whose
schema has them: here a topic has only the supported part of its schema. The messages themselves are the same bytes.
"""

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import cycle
from pathlib import Path
from typing import Any, Final

from rwa_monitor import messages
from rwa_monitor.messages import (
    Changepoints,
    Diagnosis,
    Discrepancy,
    EncodedMessage,
    Health,
    HealthAlarm,
    Message,
    SamplesMessage,
    Status,
    dump_json,
)
from rwa_monitor.samples import CHANNELS, NANOSECONDS_PER_SECOND

TELEMETRY: Final = "telemetry"
JUMP: Final = "jump"
PART: Final = "part"
PART_FIELDS: Final = ("probability", "severity", "estimate", "nominal_low", "nominal_high")
LOG: Final = "log"
LOG_SCHEMA: Final = "foxglove.Log"


class LogLevel(IntEnum):
    """Levels of foxglove.Log."""

    DEBUG = 1
    INFO = 2
    WARNING = 3
    ERROR = 4
    FATAL = 5


VERDICT_LEVELS: Final = {
    "nominal": LogLevel.INFO,
    "inconclusive": LogLevel.WARNING,
    "anomalous": LogLevel.ERROR,
}
ALARM_LEVELS: Final = {
    "normal": LogLevel.INFO,
    "watch": LogLevel.WARNING,
    "warning": LogLevel.WARNING,
    "distress": LogLevel.ERROR,
    "critical": LogLevel.FATAL,
}


@dataclass(slots=True)
class _Wheel:
    """State of a wheel from its messages so far."""

    key: str  # without the kind
    name: str
    clock_ns: int = 0  # of its latest sample
    last_error: str | None = None
    alarms: dict[str, HealthAlarm] = field(default_factory=dict)


class Translator:
    """Translates messages of the bus, in their order, into messages for Foxglove."""

    def __init__(self) -> None:
        self._wheels: dict[tuple[str, str], _Wheel] = {}

    def translate(self, key: str, payload: bytes) -> list[EncodedMessage]:
        """Return the messages for Foxglove of one message, none for an unknown kind.

        Raises
        ------
        InputError
            If the key is not one of the bus, or the message is invalid.
        """
        spacecraft, name, kind = messages.split_key(key)
        if kind not in messages.KINDS:
            return []
        message = messages.KINDS[kind].parse(payload, key)
        key = f"{messages.KEY_PREFIX}/{spacecraft}/{name}"
        wheel = self._wheels.setdefault((spacecraft, name), _Wheel(key, f"{spacecraft}/{name}"))
        if isinstance(message, SamplesMessage):
            wheel.clock_ns = message.time_ns[-1]
        own = EncodedMessage(f"{key}/{kind}", message.schema_name(), payload, _time_ns(message, wheel))
        return [own, *_additional(message, wheel)]


def _time_ns(message: Message, wheel: _Wheel) -> int:
    match message:
        case Diagnosis(window_end_ns=end_ns) | Health(window_end_ns=end_ns) | Discrepancy(end_ns=end_ns):
            return end_ns
    return wheel.clock_ns


def _additional(message: Message, wheel: _Wheel) -> Iterator[EncodedMessage]:
    """Yield the additional messages of a message."""
    match message:
        case SamplesMessage():
            yield from _telemetry(message, wheel)
        case Changepoints(changepoints=jumps):
            for jump in jumps:
                content = _stamp(jump.time_ns) | {"jump_Nm": jump.jump_Nm, "confidence": jump.confidence}
                yield EncodedMessage(f"{wheel.key}/{JUMP}", "rwa.Jump", dump_json(content), jump.time_ns)
                size = f"{jump.jump_Nm * 1e3:+.3f} mN m (standard deviation {jump.std_Nm * 1e3:.3f} mN m)"
                yield _log(wheel, LogLevel.DEBUG, f"Friction jumped by {size}.", jump.time_ns)
        case Diagnosis(window_end_ns=end_ns, data=data):
            for name, anomaly in message.anomalies.items():
                values = {one: value for one in PART_FIELDS if (value := getattr(anomaly, one)) is not None}
                content = _stamp(end_ns) | {"active": anomaly.active} | values
                yield EncodedMessage(f"{wheel.key}/{PART}/{name}", "rwa.Part", dump_json(content), end_ns)
            level, text = VERDICT_LEVELS[message.verdict], message.reason
            if data or wheel.name.endswith(messages.REPLAY):  # no action is required
                level, text = LogLevel.INFO, f"{data or 'replayed'} data: {text}"
            yield _log(wheel, level, text, end_ns)
        case Discrepancy(verdict=verdict):
            level = LogLevel.WARNING if verdict == "inadequate" else LogLevel.INFO
            found = ", ".join(effect.name for effect in message.effects) or "no effect named"
            yield _log(wheel, level, f"The wheel's model is {verdict}: {found}.", message.end_ns)
        case Status(last_error=error):
            if error and error != wheel.last_error:
                yield _log(wheel, LogLevel.WARNING, error, wheel.clock_ns)
            wheel.last_error = error
        case Health(alarm_states=dict(states)):
            yield from _alarms(states, wheel, message.window_end_ns)


def _telemetry(message: SamplesMessage, wheel: _Wheel) -> Iterator[EncodedMessage]:
    """Yield one message for each sample, with its measured values."""
    measured = {name: values for name in CHANNELS if (values := getattr(message, name)) is not None}
    for i, time_ns in enumerate(message.time_ns):
        found = ((name, values[i]) for name, values in measured.items())
        values = {name: value for name, value in found if value is not None and math.isfinite(value)}
        yield EncodedMessage(f"{wheel.key}/{TELEMETRY}", "rwa.Telemetry", dump_json(_stamp(time_ns) | values), time_ns)


def _alarms(states: dict[str, HealthAlarm], wheel: _Wheel, time_ns: int) -> Iterator[EncodedMessage]:
    """Yield a log line for each alarm that changed."""
    for name, alarm in states.items():
        if alarm != wheel.alarms.get(name):
            by = f" by {alarm.acknowledged_by}" if alarm.acknowledged_by else ""
            yield _log(wheel, ALARM_LEVELS[alarm.level], f"Alarm {name}: {alarm.level}, {alarm.phase}{by}.", time_ns)
    for name in wheel.alarms.keys() - states.keys():
        yield _log(wheel, LogLevel.INFO, f"Alarm {name}: closed.", time_ns)
    wheel.alarms = dict(states)


def _stamp(time_ns: int) -> dict[str, Any]:
    seconds, nanoseconds = divmod(time_ns, NANOSECONDS_PER_SECOND)
    return {"timestamp": {"sec": seconds, "nsec": nanoseconds}}


def _log(wheel: _Wheel, level: LogLevel, text: str, time_ns: int) -> EncodedMessage:
    content = _stamp(time_ns) | {"level": int(level), "message": text, "name": wheel.name, "file": "", "line": 0}
    return EncodedMessage(f"{wheel.key}/{LOG}", LOG_SCHEMA, dump_json(content), time_ns)


# ---- schemas ---------------------------------------------------------------------------------------------------------

PLAIN_TYPES: Final = {"boolean": "boolean", "string": "string", "number": "number", "integer": "number"}
TIMESTAMP: Final = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
}


def schemas() -> dict[str, dict[str, Any]]:
    """Return the JSON Schema of every topic by its name, as far as Foxglove reads it."""
    numbers = {name: {"type": "number"} for name in CHANNELS}
    jump = {"jump_Nm": {"type": "number"}, "confidence": {"type": "number"}}
    part = {"active": {"type": "boolean"}} | {name: {"type": "number"} for name in PART_FIELDS}
    # https://docs.foxglove.dev/docs/sdk/schemas/log
    levels = [{"title": "UNKNOWN", "const": 0}, *({"title": level.name, "const": int(level)} for level in LogLevel)]
    text: dict[str, Any] = {"type": "string"}
    log = {"level": {"oneOf": levels}, "message": text, "name": text, "file": text, "line": {"type": "integer"}}
    own = {"rwa.Telemetry": numbers, "rwa.Jump": jump, "rwa.Part": part, LOG_SCHEMA: log}
    found = {
        name: {"title": name, "type": "object", "properties": {"timestamp": TIMESTAMP} | fields}
        for name, fields in own.items()
    }
    for message in messages.KINDS.values():
        schema = message.json_schema()
        readable = _readable(schema, schema.get("$defs", {})) or {}
        found[message.schema_name()] = {"title": message.schema_name()} | readable
    return found


def _readable(schema: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any] | None:
    """Return the part of a schema that Foxglove supports, with references resolved; None if there is none."""
    if "$ref" in schema:
        return _readable(definitions[schema["$ref"].rsplit("/", 1)[-1]], definitions)
    if "anyOf" in schema:
        choices = [choice for choice in schema["anyOf"] if choice.get("type") != "null"]
        return _readable(choices[0], definitions) if len(choices) == 1 else None
    kind = schema.get("type")
    if kind == "object":
        fields = {name: _readable(value, definitions) for name, value in schema.get("properties", {}).items()}
        known = {name: value for name, value in fields.items() if value is not None}
        return {"type": "object", "properties": known} if known else None
    if kind == "array":
        items = _readable(schema.get("items", {}), definitions)
        return None if items is None or items["type"] == "array" else {"type": "array", "items": items}
    return {"type": PLAIN_TYPES[kind]} if kind in PLAIN_TYPES else None


# ---- the layout ------------------------------------------------------------------------------------------------------

# Layout of one wheel, with placeholders for its key, its number and a part of its friction.
LAYOUT_OF_A_WHEEL: Final = Path(__file__).with_name("foxglove_layout.json")
# Colours of the parts, distinguishable with colour blindness (Okabe and Ito 2008).
COLOURS: Final = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00")


class Seen:
    """The content of a layout: the wheels by their keys, and the parts of each wheel's friction, in order of arrival.

    `paths` are the fields that have values, as Foxglove's message paths.
    """

    def __init__(self) -> None:
        self.wheels: dict[str, dict[str, None]] = {}
        self.paths: set[str] = set()

    def add(self, views: Iterable[EncodedMessage]) -> None:
        """Add the wheels, parts and fields of messages for Foxglove."""
        for view in views:
            *key, kind = view.topic.split("/", 3)
            parts = self.wheels.setdefault("/".join(key), {})
            if kind.startswith(f"{PART}/"):
                parts[kind.removeprefix(f"{PART}/")] = None
            if kind != SamplesMessage.kind:  # its arrays are not plotted
                self.paths.update(f'"{view.topic}".{name}' for name in json.loads(view.payload))


def layout(seen: Seen) -> bytes:
    """Return a layout as JSON, in the form that Foxglove and Lichtblick import: a tab for each wheel.

    A tab shows the wheel's speed, friction, current, temperature, jumps, parts, verdict and log.
    """
    panels: dict[str, Any] = {}
    tabs = []
    template = LAYOUT_OF_A_WHEEL.read_text(encoding="utf-8")
    for number, (key, parts) in enumerate(seen.wheels.items(), 1):
        wheel = json.loads(template.replace("NUMBER", str(number)).replace("KEY", key))
        for name in ("probability", "severity"):
            panel = wheel["panels"][f"Plot!{name}_{number}"]
            line = json.dumps(panel["paths"][0])
            panel["paths"] = [
                json.loads(line.replace("PART", part)) | {"color": colour}
                for part, colour in zip(parts, cycle(COLOURS), strict=False)
            ]
        for panel in wheel["panels"].values():
            if "paths" in panel:
                panel["paths"] = [line for line in panel["paths"] if line["value"] in seen.paths]
        panels |= wheel["panels"]
        tabs.append({"title": key.split("/", 1)[1], "layout": wheel["layout"]})
    panels["Tab!wheels"] = {"activeTabIdx": 0, "tabs": tabs}
    whole = {"globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1}, "layout": "Tab!wheels"}
    return json.dumps({"configById": panels} | whole, indent=2, ensure_ascii=False).encode() + b"\n"
