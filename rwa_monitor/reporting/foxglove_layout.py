"""A layout for Foxglove: a tab for each wheel with its speed, friction, jumps, parts, verdict and log.

Written in the form in which Foxglove and Lichtblick import a layout from a file.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from typing import Any, Final

from rwa_monitor.messages import Diagnosis
from rwa_monitor.reporting.foxglove import JUMP, LOG, PART, TELEMETRY, View

TITLES: Final = {
    "speed_rad_s": "speed [rad/s]",
    "friction_torque_Nm": "friction [N m]",
    "motor_current_A": "motor current [A]",
    "motor_torque_Nm": "motor torque [N m]",
    "motor_voltage_V": "motor voltage [V]",
    "bearing_temperature_degC": "bearing temperature [°C]",
}
PLAIN_TOPIC: Final = re.compile(r"[\w/-]+", re.ASCII)
# A colour for each part that colour-blind people can tell apart (Okabe and Ito 2008).
COLOURS: Final = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00")


class Seen:
    """What a layout can show: the topics of each wheel, and what was measured."""

    def __init__(self) -> None:
        self.wheels: dict[str, dict[str, None]] = {}  # by key, in the order in which they came

    def add(self, views: Iterable[View]) -> None:
        """Take in what Foxglove is shown."""
        for view in views:
            key, kind = _split(view.topic)
            known = self.wheels.setdefault(key, {})
            known[kind] = None
            if kind == TELEMETRY:
                known.update(dict.fromkeys(f"{TELEMETRY}.{name}" for name in json.loads(view.payload)))


def _split(topic: str) -> tuple[str, str]:
    """Return the wheel's key, and the rest of a topic."""
    prefix, spacecraft, wheel, rest = topic.split("/", 3)
    return f"{prefix}/{spacecraft}/{wheel}", rest


def layout(seen: Seen) -> bytes:
    """Return the layout as JSON."""
    panels: dict[str, Any] = {}
    tabs = [
        {"title": key.split("/", 1)[1], "layout": _wheel(number, key, list(known), panels)}
        for number, (key, known) in enumerate(seen.wheels.items(), 1)
    ]
    panels["Tab!wheels"] = {"activeTabIdx": 0, "tabs": tabs}
    content = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": "Tab!wheels",
    }
    return json.dumps(content, indent=2, ensure_ascii=False).encode() + b"\n"


def _wheel(number: int, key: str, known: list[str], panels: dict[str, Any]) -> Any:
    """Add the panels of a wheel; returns how they stand."""
    left: list[str] = []
    for channel, title in TITLES.items():
        if f"{TELEMETRY}.{channel}" in known:
            left.append(_plot(f"{channel}_{number}", title, [_line(key, TELEMETRY, channel, channel)], panels))
    if JUMP in known:
        jump = _line(key, JUMP, "jump_Nm", "jump") | {"showLine": False}
        left.append(_plot(f"jumps_{number}", "jumps of friction, provisional [N m]", [jump], panels))
    right: list[str] = []
    parts = [kind for kind in known if kind.startswith(f"{PART}/")]
    for field, title in (("probability", "probability of an anomaly"), ("severity", "severity")):
        lines = [
            _line(key, kind, field, kind.removeprefix(f"{PART}/"), COLOURS[i % len(COLOURS)])
            for i, kind in enumerate(parts)
        ]
        if lines:
            right.append(_plot(f"{field}_{number}", title, lines, panels))
    if Diagnosis.kind in known:
        verdict = {"value": _path(key, Diagnosis.kind, "verdict"), "label": "verdict", "timestampMethod": "receiveTime"}
        right.append(f"StateTransitions!verdict_{number}")
        panels[right[-1]] = {"paths": [verdict], "isSynced": True, "foxglovePanelTitle": "verdict"}
    if LOG in known:
        right.append(f"RosOut!log_{number}")
        panels[right[-1]] = {
            "topicToRender": f"{key}/{LOG}",
            "minLogLevel": 1,
            "searchTerms": [],
            "nameFilter": {},
            "foxglovePanelTitle": "log",
        }
    columns = [_stack(column, "column") for column in (left, right) if column]
    return _stack(columns, "row")


def _stack(panels: list[Any], direction: str) -> Any:
    """Return panels below or beside each other, all of one size."""
    if len(panels) == 1:
        return panels[0]
    rest = _stack(panels[1:], direction)
    return {"direction": direction, "first": panels[0], "second": rest, "splitPercentage": 100 / len(panels)}


def _plot(name: str, title: str, lines: list[dict[str, Any]], panels: dict[str, Any]) -> str:
    panels[f"Plot!{name}"] = {
        "paths": lines,
        "foxglovePanelTitle": title,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "showLegend": True,
        "legendDisplay": "floating",
        "showPlotValuesInLegend": False,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "sidebarDimension": 240,
    }
    return f"Plot!{name}"


def _line(key: str, kind: str, field: str, label: str, colour: str = COLOURS[0]) -> dict[str, Any]:
    path = _path(key, kind, field)
    return {"value": path, "label": label, "color": colour, "enabled": True, "timestampMethod": "receiveTime"}


def _path(key: str, kind: str, field: str) -> str:
    """Return a message path; a topic with other signs than letters, digits, _, - and / stands in quotes."""
    topic = f"{key}/{kind}"
    return f"{topic if PLAIN_TOPIC.fullmatch(topic) else json.dumps(topic)}.{field}"
