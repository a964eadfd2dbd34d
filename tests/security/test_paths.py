"""A name in a key, a file or a request cannot lead out of its folder."""

from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path
from threading import Event

import pytest
import zenoh

from rwa_monitor.dashboard.server import DashboardOptions, serve
from rwa_monitor.errors import InputError
from rwa_monitor.messages import EncodedMessage, SamplesMessage, samples_json, split_key
from rwa_monitor.monitor.core import WheelCore
from rwa_monitor.monitor.recorder import RecordingWriter
from rwa_monitor.monitor.replay import run_recording
from rwa_monitor.monitor.telemetry_files import read_telemetry
from rwa_monitor.telemetry.labels import read_labels
from tests.monitor.support import model, telemetry, wheel
from tests.program import refused

ESCAPED = ["%2e%2e", "..%2fx", "a\\b", "a\x00b", "a\nb"]
LEADING_OUT = ["..", ".", "", "/", "/etc", "../x", "a/b", "~/x y", "*", "**", "$*", *ESCAPED]


@pytest.mark.parametrize("name", LEADING_OUT)
def test_a_key_names_nothing_that_is_no_plain_name(name: str) -> None:
    for key in (f"rwa/{name}/wheel/samples", f"rwa/sat/{name}/samples", f"{name}/sat/wheel/samples"):
        assert refused(lambda key=key: split_key(key))


@pytest.mark.parametrize("of", ["checkpoint", "wheels"])
@pytest.mark.parametrize("name", LEADING_OUT)
def test_a_recording_names_no_wheel_that_leads_out(name: str, of: str, tmp_path: Path) -> None:
    made_with = {
        "wheel.toml": wheel().to_toml(),
        "model.json": model().to_json(),
        "settings.json": '{"method": "joint"}',
        "checkpoint/sat/wheel_1.json": WheelCore(wheel(), model()).checkpoint().decode(),
    }
    named = {"wheels/sat/wheel_1.toml": made_with["wheel.toml"], **made_with} if of == "wheels" else made_with
    attachments = [
        (attached.replace("wheel_1", name) if attached.startswith(of) else attached, text.encode())
        for attached, text in named.items()
    ]
    RecordingWriter(tmp_path / "x.mcap", attachments, lambda: 0).close()
    with pytest.raises(InputError, match=r"wheel|name"):
        run_recording(tmp_path / "x.mcap", Event(), lambda *_: None)


def test_a_recorded_topic_names_no_wheel_that_leads_out(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "x.mcap", (), lambda: 0)
    payload = samples_json(telemetry(16), "p", 0)
    writer.write(EncodedMessage("rwa/../etc/samples", SamplesMessage.schema_name(), payload))
    writer.close()
    with pytest.raises(InputError, match=r"rwa/\.\./etc/samples"):
        read_telemetry(tmp_path / "x.mcap")


@pytest.mark.parametrize(
    ("file", "reason"),
    [
        ("../outside.csv", "has '..' in it, which leads out of the folder"),
        ("in/../../outside.csv", "has '..' in it"),
        ("/etc/hostname", "is an absolute path and not in the folder of the labels"),
        ("a\x00b", "holds a zero byte"),
    ],
)
def test_labels_name_no_file_outside_their_folder(file: str, reason: str, tmp_path: Path) -> None:
    folder = tmp_path / "labels"
    (folder / "in").mkdir(parents=True)
    (tmp_path / "outside.csv").write_text("")
    (folder / "labels.csv").write_text(f"file,dry,viscous\n{file},0,1\n")
    with pytest.raises(InputError, match=reason):
        read_labels(folder / "labels.csv")


def test_labels_may_name_files_in_their_folder_absolutely(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, link = tmp_path / "labels", tmp_path / "link"
    folder.mkdir()
    link.symlink_to(folder)
    named = [folder / "a.csv", link / "b.csv"]
    for file in named:
        file.write_text("")
    (folder / "labels.csv").write_text("file,dry,viscous\n" + "".join(f"{file},0,1\n" for file in named))
    monkeypatch.chdir(folder)
    for labels in (folder / "labels.csv", link / "labels.csv", Path("labels.csv")):
        assert [entry.path for entry in read_labels(labels)] == named
    (tmp_path / "labels.csv").write_text(f"file,dry,viscous\n{folder}x/a.csv,0,1\n")
    with pytest.raises(InputError, match="there is no file"):
        read_labels(tmp_path / "labels.csv")


REQUESTS = (
    "/api/recordings/..%2foutside.mcap",
    "/api/recordings/%2e%2e%2foutside.mcap",
    "/api/recordings/%252e%252e%252foutside.mcap",
    "/api/recordings/..\\outside.mcap",
    "/api/recordings/%00",
    "/api/recordings/history.sqlite3",
    "/static/../app.py",
    "/static/..%2fapp.py",
    "/static/%2e%2e/app.py",
    "/static//etc/hostname",
)


def test_the_page_serves_nothing_outside_its_folders(session: zenoh.Session, tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    folder.mkdir()
    (tmp_path / "outside.mcap").write_bytes(b"\x89MCAP0\r\n")
    with (
        serve(DashboardOptions(0, folder), session, lambda _: None) as running,
        closing(HTTPConnection(running.address.removeprefix("http://").rstrip("/"))) as server,
    ):
        found = {}
        for path in (*REQUESTS, "/static/style.css"):
            server.request("GET", path)
            with server.getresponse() as response:
                response.read()
                found[path] = response.status
    assert found.pop("/static/style.css") == 200  # the control
    assert set(found.values()) <= {404, 422}, found
