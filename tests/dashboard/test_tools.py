"""What other tools get: metrics for Prometheus, a dashboard file for Grafana, a webhook."""

from __future__ import annotations

import json
import re
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
import zenoh

from rwa_monitor.dashboard import alarm_notifier
from rwa_monitor.dashboard.fleet import Fleet
from rwa_monitor.dashboard.metrics import metrics
from rwa_monitor.dashboard.server import DashboardOptions, serve
from rwa_monitor.errors import InputError
from tests.dashboard.support import acknowledge, reporting, send_windows
from tests.monitor.processes import wait_for

GRAFANA = Path("docs/integrations/grafana.json")
NAME = r"[a-zA-Z_:][a-zA-Z0-9_:]*"
LABEL = r'[a-zA-Z_][a-zA-Z0-9_]*="(?:[^"\\\n]|\\\\|\\"|\\n)*"'
SAMPLE = re.compile(rf"({NAME})(?:\{{({LABEL}(?:,{LABEL})*)\}})? (\S+)")

pytestmark = pytest.mark.processes


def parse(text: str) -> dict[str, dict[str, Any]]:
    """Read the text format as strictly as promtool does; returns type, labels and values of each metric."""
    assert text.endswith("\n")
    found: dict[str, dict[str, Any]] = {}
    seen: set[tuple[str, str]] = set()
    name = ""
    for line in text.splitlines():
        if line.startswith("# HELP "):
            name, words = line.removeprefix("# HELP ").split(" ", 1)
            assert words
            assert name not in found, "a metric's lines stand together"
            found[name] = {"kind": "", "labels": set(), "values": []}
        elif line.startswith("# TYPE "):
            _, _, typed, kind = line.split(" ")
            assert typed == name
            assert not found[name]["kind"]
            found[name]["kind"] = kind
            assert kind in {"gauge", "counter"}
            assert (kind == "counter") == name.endswith("_total")
        else:
            match = SAMPLE.fullmatch(line)
            assert match is not None, line
            assert match[1] == name
            assert (name, match[2]) not in seen, "no sample twice"
            seen.add((name, match[2]))
            found[name]["labels"] |= set(re.findall(rf"({NAME})=\"", match[2] or ""))
            found[name]["values"].append(float(match[3]))
    assert all(one["kind"] for one in found.values())
    return found


@pytest.fixture
def scraped(session: zenoh.Session, tmp_path: Path) -> Iterator[dict[str, dict[str, Any]]]:
    with (
        serve(DashboardOptions(0, tmp_path), session) as running,
        reporting(session, "wheel_1", "wheel_2", samples_used=7, slots_missed=2),
    ):
        send_windows(session, "wheel_1", failing=False)
        send_windows(session, "wheel_2", failing=True)

        def text() -> str:
            with urllib.request.urlopen(running.address + "metrics", timeout=10) as answer:
                assert answer.headers["Content-Type"].startswith("text/plain; version=0.0.4")
                return str(answer.read().decode())

        wait_for(lambda: 'level="warning",phase="active"} 1.0' in text(), "the alarm in the metrics")
        wait_for(lambda: text().count("rwa_monitor_slots_missed_total{") == 2, "both monitors in the metrics")
        yield parse(text())


def test_the_metrics_are_in_prometheus_format_and_hold_what_is_known(scraped: dict[str, dict[str, Any]]) -> None:
    assert sum(scraped["rwa_wheel_verdict"]["values"]) == 2
    assert sorted(scraped["rwa_wheel_severity"]["values"]) == [0.0, 1.0]
    assert scraped["rwa_monitor_slots_missed_total"]["values"] == [2.0, 2.0]
    assert sum(scraped["rwa_monitor_samples_total"]["values"]) == 14.0
    assert all(value < 20.0 for value in scraped["rwa_monitor_status_age_seconds"]["values"])


def test_grafanas_file_asks_for_what_the_metrics_have(scraped: dict[str, dict[str, Any]]) -> None:
    board = json.loads(GRAFANA.read_text())
    ids = [panel["id"] for panel in board["panels"]]
    assert len(set(ids)) == len(ids) > 5
    asked = [target["expr"] for panel in board["panels"] for target in panel["targets"]]
    asked += [one["query"] for one in board["templating"]["list"] if one["type"] == "query"]
    legends = [target["legendFormat"] for panel in board["panels"] for target in panel["targets"]]
    for expression in asked:
        names = re.findall(r"\brwa_\w+", expression)
        assert names, expression
        labels = set(re.findall(r"(\w+)(?:=~|!=|=)\"", expression))
        for name in names:
            assert name in scraped, name
            assert labels <= scraped[name]["labels"], (name, labels)
            assert scraped[name]["values"], name
    known = set().union(*(one["labels"] for one in scraped.values()))
    assert set(re.findall(r"{{(\w+)}}", " ".join(legends))) <= known


def test_labels_are_escaped_and_an_empty_fleet_has_metrics() -> None:
    fleet = Fleet()
    wheel = fleet.begin("sat", 'a "quoted" \\ and\na new line', [])
    assert wheel is not None
    wheel.rhythm.wall_ns = 0
    assert r'{spacecraft="sat",wheel="a \"quoted\" \\ and\na new line"} 60.0' in metrics(fleet, [], 0)
    assert parse(metrics(Fleet(), [], 0))["rwa_dashboard_info"]["values"] == [1.0]


class Listening(HTTPServer):
    """Takes posts, and refuses a number of them first."""

    def __init__(self, refusals: int) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.refusals = refusals
        self.taken: list[dict[str, Any]] = []


class Handler(BaseHTTPRequestHandler):
    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        assert isinstance(self.server, Listening)
        if self.server.refusals:
            self.server.refusals -= 1
            self.send_error(503)
            return
        self.server.taken.append(json.loads(body))
        self.send_response(204)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def listening(refusals: int = 0) -> Iterator[Listening]:
    with Listening(refusals) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def test_each_change_of_an_alarm_is_posted_and_posted_again_until_it_is_taken(
    session: zenoh.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(alarm_notifier, "FIRST_WAIT_S", 0.01)
    with listening(refusals=2) as other:
        options = DashboardOptions(0, tmp_path, token="right", webhook=f"http://127.0.0.1:{other.server_port}/alarms")
        with serve(options, session) as running:
            send_windows(session, "wheel_1", failing=True)
            wait_for(lambda: other.taken, "the alarm at the webhook")
            assert acknowledge(running.address) == 200
            wait_for(lambda: len(other.taken) == 2, "the acknowledgement at the webhook")
    assert [(one["wheel"], one["name"], one["phase"]) for one in other.taken] == [
        ("wheel_1", "viscous", "active"),
        ("wheel_1", "viscous", "acknowledged"),
    ]


@pytest.mark.parametrize("url", ["file:///etc/passwd", "nothing", "http://"])
def test_a_webhook_that_is_no_address_is_refused(session: zenoh.Session, url: str) -> None:
    with pytest.raises(InputError, match="no http or https URL"), serve(DashboardOptions(0, webhook=url), session):
        pass
