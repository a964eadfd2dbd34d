"""Recordings for Foxglove: what its panels need, from real recordings; the recordings stay as they are."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from mcap.reader import make_reader

from rwa_monitor.errors import InputError
from rwa_monitor.messages import Diagnosis, EncodedMessage, HealthAlarm, Message, health_message
from rwa_monitor.monitor.recorder import write_foxglove
from rwa_monitor.monitor.recording import read_recording
from rwa_monitor.reporting.foxglove import Seen, Translator, layout, schemas
from tests.program import run

REPLAY = Path("replay")
KEY = "rwa/reference/wheel_1"
Topics = dict[str, list[dict[str, Any]]]


def topics_of(path: Path) -> Topics:
    """Read a file with the mcap package's own reader; every message must fit its schema."""
    found: Topics = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            content = json.loads(message.data)
            if not channel.topic.endswith("/samples"):  # long arrays, which have null for what was not measured
                validator(schema.data).validate(content)
            found.setdefault(channel.topic, []).append(content)
    return found


@cache
def validator(schema: bytes) -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(without_types(json.loads(schema)))


def without_types(schema: dict[str, Any]) -> dict[str, Any]:
    """Allow null for every plain type: Foxglove's schemas have no such type."""
    kind = schema.get("type")
    if kind == "object":
        fields = {name: without_types(value) for name, value in schema["properties"].items()}
        return {"type": ["object", "null"], "properties": fields}
    if kind == "array":
        return {"type": ["array", "null"], "items": without_types(schema["items"])}
    return {"type": [kind, "null"]} if kind else schema


@pytest.fixture(scope="module", params=["two_anomalies", "heat", "bad_day", "dry", "nominal"])
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Topics, Any]:
    source, target = REPLAY / request.param, tmp_path_factory.mktemp("foxglove") / "out.mcap"
    result = run("foxglove", source, "-o", target)
    assert result.exit_code == 0, result.output
    return source, topics_of(target), json.loads((target.parent / "out.layout.json").read_bytes())


def resolve(path: str, topics: Topics) -> list[Any]:
    """Return what a message path of the layout (topic, then fields) finds."""
    topic, field = path.removeprefix('"').split('".')
    return [value[field] for value in topics[topic] if field in value]


def test_every_topic_and_path_of_the_layout_is_in_a_real_recording(written: tuple[Path, Topics, Any]) -> None:
    _, topics, drawn = written
    panels = drawn["configById"]
    paths = [line["value"] for panel in panels.values() for line in panel.get("paths", ())]
    for path in paths:
        assert any(value is not None for value in resolve(path, topics)), path
    assert {panel["topicToRender"] for name, panel in panels.items() if name.startswith("RosOut!")} == {f"{KEY}/log"}
    friction = "motor_current_A" if written[0].name == "two_anomalies" else "friction_torque_Nm"
    wanted = ('telemetry".speed_rad_s', f'telemetry".{friction}', 'jump".jump_Nm', 'diagnosis".verdict')
    wanted += ('part/dry".probability', 'part/fss_2".severity')
    assert {f'"{KEY}/{one}' for one in wanted} <= set(paths)


def test_what_the_recording_holds_is_there_byte_for_byte(written: tuple[Path, Topics, Any]) -> None:
    source, topics, _ = written
    recorded = [message for path in sorted(source.iterdir()) for message in read_recording(path).messages]
    for kind in ("samples", "diagnosis", "health", "changepoints", "status"):
        recorded_content = [json.loads(message.payload) for message in recorded if message.topic == f"{KEY}/{kind}"]
        assert sorted(topics[f"{KEY}/{kind}"], key=repr) == sorted(recorded_content, key=repr)
    batches = topics[f"{KEY}/samples"]
    assert len(topics[f"{KEY}/telemetry"]) == sum(len(batch["time_ns"]) for batch in batches)
    first = topics[f"{KEY}/telemetry"][0]
    assert first["timestamp"] == {"sec": 0, "nsec": 0}
    assert first["speed_rad_s"] == batches[0]["speed_rad_s"][0]


def test_diagnoses_and_trouble_are_lines_of_the_log(written: tuple[Path, Topics, Any]) -> None:
    _, topics, _ = written
    log = topics[f"{KEY}/log"]
    for diagnosis in topics[f"{KEY}/diagnosis"]:
        level = {"nominal": 2, "inconclusive": 3, "anomalous": 4}[diagnosis["verdict"]]
        assert any(line["message"] == diagnosis["reason"] and line["level"] == level for line in log)
    for status in topics[f"{KEY}/status"]:
        if status["last_error"]:
            assert [line["level"] for line in log if line["message"] == status["last_error"]] == [3]
    assert {line["name"] for line in log} == {"reference/wheel_1"}


def test_of_a_recording_that_is_cut_what_is_left_is_written_and_the_exit_code_is_3(tmp_path: Path) -> None:
    data = (REPLAY / "nominal" / "rwa-000001.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) // 2])
    result = run("foxglove", tmp_path / "cut.mcap", "-o", tmp_path / "out.mcap")
    assert result.exit_code == 3, result.output
    assert topics_of(tmp_path / "out.mcap")[f"{KEY}/telemetry"]


def test_foxglove_can_read_every_schema() -> None:
    """Its reader refuses what is no object, array or plain type (parseJsonSchema.ts of foxglove/studio)."""

    def check(schema: dict[str, Any]) -> None:
        if "oneOf" in schema:
            assert all(isinstance(choice["const"], int) for choice in schema["oneOf"])
        elif schema["type"] == "object":
            for value in schema["properties"].values():
                check(value)
        elif schema["type"] == "array":
            assert schema["items"]["type"] != "array"
            check(schema["items"])
        else:
            assert schema["type"] in {"boolean", "string", "number", "integer"}

    for schema in schemas().values():
        assert schema["type"] == "object"
        check(schema)


def recorded_diagnosis() -> Diagnosis:
    return read_recording(REPLAY / "dry" / "rwa-000001.mcap").parsed(Diagnosis)[0]


def logged(translator: Translator, message: Message, key: str = KEY) -> list[tuple[int, str]]:
    """Return level and text of the lines of the log for a message."""
    views = translator.translate(f"{key}/{message.kind}", message.to_json())
    lines = [json.loads(view.payload) for view in views if view.schema == "foxglove.Log"]
    return [(line["level"], line["message"]) for line in lines]


def test_each_change_of_an_alarm_is_a_line() -> None:
    active = HealthAlarm(level="distress", phase="active", acknowledged_by=None)
    seen = HealthAlarm(level="distress", phase="acknowledged", acknowledged_by="Ada")
    translator, health = Translator(), health_message(recorded_diagnosis())
    states = ({"dry": active}, {"dry": active}, {"dry": seen}, {})
    changes = [health.model_copy(update={"alarm_states": alarms}) for alarms in states]
    assert [line for change in changes for line in logged(translator, change)] == [
        (4, "Alarm dry: distress, active."),
        (4, "Alarm dry: distress, acknowledged by Ada."),
        (2, "Alarm dry: closed."),
    ]


def test_a_window_that_is_not_live_is_no_error_in_the_log() -> None:
    bad = recorded_diagnosis().model_copy(update={"verdict": "anomalous", "reason": "It is."})
    late = bad.model_copy(update={"data": "stored"})
    assert logged(Translator(), bad) == [(4, "It is.")]
    assert logged(Translator(), late) == [(2, "stored data: It is.")]
    assert logged(Translator(), bad, f"{KEY}@replay") == [(2, "replayed data: It is.")]


def test_a_topic_with_other_signs_stands_in_quotes() -> None:
    seen = Seen()
    seen.add([EncodedMessage("rwa/sat-1/wheel.2/telemetry", "rwa.Telemetry", b'{"speed_rad_s":1.0}', 0)])
    panels = json.loads(layout(seen))["configById"]
    assert panels["Plot!speed_rad_s_1"]["paths"][0]["value"] == '"rwa/sat-1/wheel.2/telemetry".speed_rad_s'


def test_nothing_is_overwritten_and_what_is_no_recording_leaves_nothing(tmp_path: Path) -> None:
    target, wrong = tmp_path / "out.mcap", tmp_path / "wrong.mcap"
    wrong.write_bytes(b"no recording")
    with pytest.raises(InputError, match="no MCAP file"):
        write_foxglove([REPLAY / "nominal", wrong], target)
    assert list(tmp_path.iterdir()) == [wrong]
    target.touch()
    with pytest.raises(InputError, match="exists already"):
        write_foxglove([REPLAY / "nominal"], target)
