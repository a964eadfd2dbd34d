"""What all messages have in common: limits, how they are read, written and called, the keys they stand on.

What we write is deterministic: fixed order of keys, shortest decimal form of every number, no NaN. What we read is
limited in size before it is parsed, and a message that does not fit its model is refused with the place and the reason.
"""

from __future__ import annotations

import json
import re
from typing import Annotated, Any, ClassVar, Final, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rwa_monitor.errors import InputError
from rwa_monitor.samples import MAX_TIME_NS

MAX_MESSAGE_BYTES: Final = 8 * 2**20  # 100,000 samples of three channels are some 6 MB
MAX_SAMPLES: Final = 100_000  # of one message: 3.5 hours at 8 Hz
MAX_CLOCK_NS: Final = 2**62  # of times in outputs: beyond every sample, and sums of two fit in 64 bits
MAX_COUNT: Final = 2**53  # integers that every JSON reader keeps exactly

Count = Annotated[int, Field(ge=0, le=MAX_COUNT)]
TimeNs = Annotated[int, Field(ge=0, le=MAX_TIME_NS)]
ClockNs = Annotated[int, Field(ge=-MAX_CLOCK_NS, le=MAX_CLOCK_NS)]
Slot = Annotated[int, Field(ge=-MAX_COUNT, le=MAX_COUNT)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Name = Annotated[str, Field(max_length=200)]
Verdict = Literal["nominal", "anomalous", "inconclusive"]


class Message(BaseModel):
    """Base of all messages."""

    model_config = ConfigDict(frozen=True, strict=True, extra="ignore")

    kind: ClassVar[str]  # last part of the key

    @classmethod
    def schema_name(cls) -> str:
        """Return the name of the schema, such as rwa.Diagnosis."""
        return f"rwa.{cls.__name__}"

    @classmethod
    def encoding(cls) -> str:
        """Return the Zenoh encoding."""
        return f"application/json;{cls.schema_name()}"

    @classmethod
    def json_schema(cls) -> dict[str, Any]:
        """Return the JSON Schema (draft 2020-12) of the message."""
        mode: Literal["validation", "serialization"] = "validation" if cls.kind == "samples" else "serialization"
        schema = cls.model_json_schema(mode=mode)
        schema["title"] = cls.schema_name()
        return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}

    @classmethod
    def parse(cls, payload: bytes, source: str) -> Self:
        """Read a message.

        Raises
        ------
        InputError
            If it is too large, is no JSON, or a field is missing or wrong; names the field.
        """
        if len(payload) > MAX_MESSAGE_BYTES:
            raise InputError(source, f"has {len(payload)} bytes, more than {MAX_MESSAGE_BYTES}")
        try:
            return cls.model_validate_json(payload)
        except ValidationError as error:
            raise InputError.of_validation(source, error) from error

    def to_json(self) -> bytes:
        """Write the message; the same values always give the same bytes."""
        return dump_json(self.model_dump(mode="python"))


def dump_json(content: Any) -> bytes:
    """Write plain content as compact JSON, keys in their own order.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    return json.dumps(content, separators=(",", ":"), allow_nan=False, ensure_ascii=False).encode()


# ---- keys ------------------------------------------------------------------------------------------------------------

KEY_PREFIX: Final = "rwa"
# What a spacecraft or wheel may be called on the bus: no wildcards of key expressions, nothing that a path could use.
_NAME: Final = re.compile(r"[A-Za-z0-9_@+~-][A-Za-z0-9_.@+~-]{0,99}")


def key_of(message: type[Message], spacecraft: str, wheel: str) -> str:
    """Return the key, and topic, of a message."""
    return f"{KEY_PREFIX}/{spacecraft}/{wheel}/{message.kind}"


def split_key(key: str) -> tuple[str, str, str]:
    """Return spacecraft, wheel and kind of a key.

    Raises
    ------
    InputError
        If the key is not rwa/{spacecraft}/{wheel}/{kind}, or a name holds more than letters, digits and _.@+~-.
    """
    parts = key.split("/")
    if len(parts) != 4 or parts[0] != KEY_PREFIX or not all(_NAME.fullmatch(part) for part in parts[1:]):
        raise InputError(
            key, "is no key of the form rwa/{spacecraft}/{wheel}/{kind}, names of letters, digits and _.@+~-"
        )
    return parts[1], parts[2], parts[3]
