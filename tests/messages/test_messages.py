"""The messages: what is read, what is refused, and that the schemas are in step."""

import json
from pathlib import Path

import hypothesis.strategies as st
import jsonschema
import numpy as np
import pytest
from hypothesis import given

from rwa_monitor import messages
from rwa_monitor.errors import InputError
from rwa_monitor.messages import (
    Changepoints,
    Diagnosis,
    Gain,
    Health,
    SamplesMessage,
    dump_json,
    health_message,
    samples_json,
    split_key,
)
from rwa_monitor.monitor.core import WheelCore
from rwa_monitor.samples import MAX_TIME_NS, TABLE_CHANNELS, Samples
from tests.monitor.support import batch_diagnoses, messages_of, model, telemetry, wheel
from tools.schemas import schema_files

SCHEMAS = Path(__file__).parents[2] / "schemas"


def test_schemas_in_the_repository_are_those_of_the_code() -> None:
    assert {path.name: path.read_text(encoding="utf-8") for path in SCHEMAS.iterdir()} == schema_files()


@pytest.mark.parametrize("message", messages.MESSAGES)
def test_schemas_are_schemas(message: type[messages.Message]) -> None:
    schema = message.json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["title"] == message.schema_name()
    assert message.encoding() == f"application/json;{message.schema_name()}"


def test_what_the_monitor_publishes_fits_the_schemas() -> None:
    core = WheelCore(wheel(), model())
    kinds = {kind.kind: kind for kind in (Diagnosis, Changepoints, Health)}
    seen = set()
    for key, payload in messages_of([*core.feed(telemetry(2_500)), *core.finish()]):
        kind = key.rsplit("/", 1)[1]
        if kind in kinds:
            seen.add(kind)
            jsonschema.validate(json.loads(payload), kinds[kind].json_schema())
            assert kinds[kind].parse(payload, key).to_json() == payload
    assert seen == set(kinds)


FLOATS = st.one_of(st.floats(), st.just(float("nan")))


@given(
    rows=st.lists(st.tuples(st.integers(0, MAX_TIME_NS), FLOATS, FLOATS), min_size=1, max_size=30),
    name=st.sampled_from(TABLE_CHANNELS[1:]),
)
def test_samples_survive_the_bus(rows: list[tuple[int, float, float]], name: str) -> None:
    time_ns, speed, other = (np.array(column) for column in zip(*rows, strict=True))
    payload = samples_json(Samples(time_ns, speed, **{name: other}), "me", 3)
    jsonschema.validate(json.loads(payload), SamplesMessage.json_schema())
    message = SamplesMessage.parse(payload, "key")
    got = message.samples()
    assert (message.publisher, message.batch) == ("me", 3)
    assert got.time_ns.tolist() == time_ns.tolist()
    # What is not finite arrives as not measured, everything else to the last bit.
    for sent, received in ((speed, got.speed_rad_s), (other, getattr(got, name))):
        np.testing.assert_array_equal(received, np.where(np.isfinite(sent), sent, np.nan))


def test_a_publisher_that_only_writes_the_arrays_is_served() -> None:
    message = SamplesMessage.parse(b'{"time_ns":[5],"speed_rad_s":[null],"motor_current_A":[2],"other":1}', "key")
    samples = message.samples()
    assert (message.publisher, message.batch) == ("", None)
    assert np.isnan(samples.speed_rad_s[0])
    assert samples.motor_current_A[0] == 2.0
    assert samples.friction_torque_Nm is None


@pytest.mark.parametrize(
    ("payload", "place"),
    [
        (b"", ""),
        (b"[]", ""),
        (b"[" * 100_000, ""),
        (b'{"speed_rad_s":[1]}', "time_ns"),
        (b'{"time_ns":[1.5],"speed_rad_s":[1]}', "time_ns.0"),
        (b'{"time_ns":[99999999999999999999],"speed_rad_s":[1]}', "time_ns.0"),
        (b'{"time_ns":[1],"speed_rad_s":["1"]}', "speed_rad_s.0"),
        (b'{"time_ns":[1],"speed_rad_s":[true]}', "speed_rad_s.0"),
        (b'{"time_ns":[1,2],"speed_rad_s":[1]}', ""),
        (b'{"time_ns":[1],"speed_rad_s":[1],"batch":-1}', "batch"),
        (b'{"time_ns":[1],"speed_rad_s":[1],"data":"later"}', "data"),
        (b'{"time_ns":[1],"speed_rad_s":[1],"publisher":"' + b"x" * 65 + b'"}', "publisher"),
    ],
)
def test_a_bad_message_is_refused_with_its_place(payload: bytes, place: str) -> None:
    with pytest.raises(InputError) as caught:
        SamplesMessage.parse(payload, "rwa/a/b/samples")
    assert caught.value.source == "rwa/a/b/samples"
    assert caught.value.place == place
    assert "\n" not in str(caught.value)


def test_what_is_not_finite_is_never_written() -> None:
    with pytest.raises(ValueError, match="JSON compliant"):
        dump_json({"value": float("nan")})


def test_health_follows_the_diagnosis() -> None:
    diagnosis = Diagnosis.parse(batch_diagnoses(telemetry(2_500), wheel())[0], "test")
    anomaly = diagnosis.anomalies["dry"].model_copy(update={"active": True, "severity": 1.5})
    sick = diagnosis.model_copy(update={"verdict": "anomalous", "anomalies": {**diagnosis.anomalies, "dry": anomaly}})
    assert health_message(sick).alarms == ["dry"]
    assert health_message(sick).severity == 1.5
    # Entries are filled in also when nothing is judged; they are no alarm then.
    unsure = sick.model_copy(update={"verdict": "inconclusive"})
    assert (health_message(unsure).alarms, health_message(unsure).severity) == ([], 0.0)
    lacking = sick.model_copy(update={"model_adequate": False})
    assert health_message(lacking).reason.startswith(health_message(sick).reason)
    assert "rwa-monitor discrepancy" in health_message(lacking).reason


@pytest.mark.parametrize("key", ["", "rwa/a/b", "rwa/a/b/c/d", "other/a/b/samples"])
def test_what_has_other_parts_is_no_key(key: str) -> None:
    with pytest.raises(InputError):
        split_key(key)
    assert split_key("rwa/sat-1/wheel_2/samples") == ("sat-1", "wheel_2", "samples")


def test_the_gain_of_a_report_is_one_of_the_message_as_a_search_writes_it() -> None:
    """A search hands over plain lists, not JSON: strict validation would refuse them for a tuple."""
    gain = dict.fromkeys(Gain.model_fields, 0) | {
        "diagnosis": None,
        "simulated": None,
        "searched_again": None,
        "searched_again_by_speed": None,
    }
    for names in ([], ["tuesday.csv"]):
        assert Gain.model_validate(gain | {"held_out": names}).held_out == names
