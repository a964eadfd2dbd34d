"""The messages on the bus: their fields, their JSON, their schemas.

Every message is one JSON object on the key rwa/{spacecraft}/{wheel}/{kind}, with the Zenoh encoding
application/json;rwa.<Message>; in a recording the same name is the schema. Times are integer nanoseconds of the wheel's
own clock. `schemas/` is generated from here (`make schemas`) and is the contract for every field.

In the order of the flow: `samples` come in; `monitor` reports on the running window; `diagnosis` closes it;
`discrepancy` is what a search found. `base` is what all have in common.
"""

from __future__ import annotations

import json
from typing import Final

from rwa_monitor.messages.base import (
    KEY_PREFIX,
    MAX_MESSAGE_BYTES,
    MAX_SAMPLES,
    ClockNs,
    Count,
    Message,
    Number,
    Slot,
    TimeNs,
    dump_json,
    key_of,
    split_key,
)
from rwa_monitor.messages.diagnosis import (
    Anomaly,
    Diagnosis,
    Friction,
    Provenance,
    Quantity,
    Residuals,
    diagnosis_message,
)
from rwa_monitor.messages.discrepancy import Discrepancy, Gain
from rwa_monitor.messages.monitor import (
    Changepoints,
    Health,
    HealthAlarm,
    ProvisionalJump,
    Status,
    health_message,
)
from rwa_monitor.messages.samples import SamplesMessage, samples_json

__all__ = [
    "KEY_PREFIX",
    "MAX_MESSAGE_BYTES",
    "MAX_SAMPLES",
    "MESSAGES",
    "Anomaly",
    "Changepoints",
    "ClockNs",
    "Count",
    "Diagnosis",
    "Discrepancy",
    "Friction",
    "Gain",
    "Health",
    "HealthAlarm",
    "Message",
    "Number",
    "Provenance",
    "ProvisionalJump",
    "Quantity",
    "Residuals",
    "SamplesMessage",
    "Slot",
    "Status",
    "TimeNs",
    "diagnosis_message",
    "dump_json",
    "health_message",
    "key_of",
    "samples_json",
    "schema_files",
    "split_key",
]

MESSAGES: Final[tuple[type[Message], ...]] = (SamplesMessage, Status, Changepoints, Diagnosis, Discrepancy, Health)


def schema_files() -> dict[str, str]:
    """Return the JSON Schemas of all messages as file name and text."""
    return {
        f"{message.schema_name()}.json": json.dumps(message.json_schema(), indent=2, ensure_ascii=False) + "\n"
        for message in MESSAGES
    }
