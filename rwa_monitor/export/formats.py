"""What can be written of a friction model, by the name of its format."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Final

from rwa_monitor.export.basilisk import basilisk_files
from rwa_monitor.export.c_source import c_files
from rwa_monitor.export.detector import detector_files
from rwa_monitor.export.fmu import fmu_files
from rwa_monitor.export.model import FrictionModel, to_json
from rwa_monitor.version import SOFTWARE


def _json_files(model: FrictionModel) -> dict[str, bytes]:
    text = json.dumps(to_json(model, SOFTWARE), indent=2, ensure_ascii=False, allow_nan=False)
    return {"rwa_friction.json": f"{text}\n".encode()}


def _c_files(model: FrictionModel) -> dict[str, bytes]:
    return {name: text.encode() for name, text in c_files(model).items()}


FORMATS: Final[Mapping[str, Callable[[FrictionModel], Mapping[str, bytes]]]] = {
    "basilisk": basilisk_files,
    "c": _c_files,
    "detector": detector_files,
    "fmu": fmu_files,
    "json": _json_files,
}
