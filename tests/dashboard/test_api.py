"""The API: what its OpenAPI document describes is what it answers, and what the feed sends."""

import json
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
import zenoh
from jsonschema import Draft202012Validator
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from rwa_monitor.dashboard.server import DashboardOptions, Running, serve
from rwa_monitor.messages import Changepoints, ProvisionalJump, samples_json
from tests.dashboard.support import RIGHT, ask, reporting, send_windows
from tests.dashboard.test_recordings import RECORDING
from tests.dashboard.test_telemetry import with_friction
from tests.history.support import START_NS, discrepancy
from tests.monitor.processes import wait_for
from tests.monitor.support import recorded

pytestmark = pytest.mark.processes


def check(document: dict[str, Any], content: Any, path: str, method: str = "get", status: str = "200") -> None:
    """Raise where content does not follow the document's schema of an answer."""
    schema = document["paths"][path][method]["responses"][status]["content"]["application/json"]["schema"]
    Draft202012Validator({**schema, "components": document["components"]}).validate(content)


def test_answers_and_feed_follow_the_document(session: zenoh.Session, tmp_path: Path) -> None:
    name = RECORDING.name
    (tmp_path / name).write_bytes(RECORDING.read_bytes())
    with serve(DashboardOptions(0, tmp_path, token="right"), session) as running, reporting(session, "wheel_1"):
        document = ask(running.address, "api/openapi.json")[1]
        assert document["openapi"].startswith("3.1")
        with connect(running.address.replace("http", "ws") + "api/feed", max_size=2**24) as feed:
            feed.send(json.dumps({"watch": "sat/wheel_1"}))
            seen: set[str] = set()

            def all_received() -> bool:
                entries = json.loads(feed.recv())
                check(document, entries, "/api/feed")
                seen.update(entry["key"].rpartition("/")[2] for entry in entries)
                wanted = "beat pulse status samples diagnosis changepoints discrepancy alarm retirement"
                return seen.issuperset(wanted.split())

            # A status goes only to who watches the wheel.
            wait_for(lambda: not all_received() and "status" in seen, "the status")
            session.put("rwa/sat/wheel_1/samples", samples_json(with_friction(4_000), "satellite", 0))
            wait_for(lambda: not all_received() and "samples" in seen, "samples of the open window")
            send_windows(session, "wheel_1", failing=True)
            jump = ProvisionalJump(index=1, time_ns=START_NS, jump_Nm=1e-4, std_Nm=1e-5, confidence=1.0)
            found = Changepoints(spacecraft="sat", wheel="wheel_1", window_start_ns=START_NS, changepoints=[jump])
            session.put("rwa/sat/wheel_1/changepoints", found.to_json())
            session.put("rwa/sat/wheel_1/discrepancy", discrepancy(1).to_json())
            send_windows(session, "wheel_2", failing=False)
            retirement = "api/wheels/sat/wheel_2/retirement"
            retired = b'{"name":"Ann","note":"retired","retire":true}'
            wait_for(lambda: ask(running.address, retirement, headers=RIGHT, body=retired)[0] == 200, "the wheel")
            wait_for(all_received, "every kind of entry")
        gets = {path for path, methods in document["paths"].items() if "get" in methods} - {"/api/feed"}
        assert len(gets) == 11
        for path in gets:
            asked = path.format(spacecraft="sat", wheel="wheel_2" if "retirement" in path else "wheel_1", name=name)
            status, content = ask(running.address, asked[1:])
            assert status == 200, asked
            assert content or path.endswith(("/trend", "/samples")), asked
            check(document, content, path)
        replayed = ask(running.address, f"api/recordings/{name}")[1]
        diagnoses = [entry["message"] for entry in replayed["entries"] if entry["key"].endswith("/diagnosis")]
        assert (replayed["problems"], diagnoses) == ([], list(map(json.loads, recorded(RECORDING))))
        posts = {
            "/api/alarms/{alarm}/acknowledge": b'{"name":"Ann"}',
            "/api/alarms/{alarm}/shelve": b'{"name":"Ann","seconds":60}',
            "/api/wheels/{spacecraft}/{wheel}/retirement": b'{"name":"Ben","retire":false}',
        }
        assert {path for path, methods in document["paths"].items() if "post" in methods} == set(posts)
        for path, body in posts.items():
            asked = path.format(alarm=1, spacecraft="sat", wheel="wheel_2")[1:]
            status, content = ask(running.address, asked, headers=RIGHT, body=body)
            assert status == 200, asked
            check(document, content, path, "post")
            status, content = ask(running.address, asked, body=body)
            assert status == 401, asked
            check(document, json.loads(content), path, "post", "401")
        for wrong in ("", ',"seconds":1e9', ',"seconds":-1', ',"seconds":NaN'):
            body = f'{{"name":"Ann"{wrong}}}'.encode()
            assert ask(running.address, "api/alarms/1/shelve", headers=RIGHT, body=body)[0] == 422, wrong


def test_a_wrong_limit_is_refused(dashboard: Running) -> None:
    for limit in ("0", "1001", "-1", "x", "1e3", "9" * 50, "²"):
        assert ask(dashboard.address, f"api/wheels/sat/wheel_1/windows?limit={quote(limit)}")[0] == 422, limit


@pytest.mark.parametrize("sent", [b"\x00", "no JSON"])
def test_a_page_that_sends_no_json_is_disconnected(dashboard: Running, sent: bytes | str) -> None:
    with connect(dashboard.address.replace("http", "ws") + "api/feed") as feed:
        feed.send(sent)
        with pytest.raises(ConnectionClosed, match="1003"):
            list(feed)
    assert ask(dashboard.address, "api/fleet")[0] == 200
