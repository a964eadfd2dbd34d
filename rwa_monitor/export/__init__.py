"""The friction model of a wheel for other simulators: C generated from the classes of its effects, an FMU, Basilisk.

`model.py` composes a wheel's friction law from its effects, with the code of their classes; each format has a module
and a template.
"""

import json
from collections.abc import Callable, Mapping
from typing import Final

from rwa_monitor.export.basilisk import basilisk_files
from rwa_monitor.export.c_source import c_files, detector_files, fmu_files
from rwa_monitor.export.model import FrictionModel, to_json


def _json_files(model: FrictionModel) -> dict[str, bytes]:
    text = json.dumps(to_json(model), indent=2, ensure_ascii=False, allow_nan=False)
    return {"rwa_friction.json": f"{text}\n".encode()}


# Writers of a friction model, by the name of the format.
FORMATS: Final[Mapping[str, Callable[[FrictionModel], Mapping[str, bytes]]]] = {
    "basilisk": basilisk_files,
    "c": c_files,
    "detector": detector_files,
    "fmu": fmu_files,
    "json": _json_files,
}
