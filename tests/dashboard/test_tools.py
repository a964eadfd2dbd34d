"""What other tools get: metrics for Prometheus, a dashboard file for Grafana."""

from __future__ import annotations

import json
import re
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from prometheus_client.parser import text_string_to_metric_families

from rwa_monitor.dashboard.server import DashboardOptions, serve
from tests.dashboard.support import reporting, send_windows
from tests.monitor.processes import wait_for

GRAFANA = Path("docs/integrations/grafana.json")

pytestmark = pytest.mark.processes


def parse(text: str) -> dict[str, dict[str, Any]]:
    """Read the text with Prometheus's own parser; returns labels and values by the name of the samples."""
    found: dict[str, dict[str, Any]] = {}
    for family in text_string_to_metric_families(text):
        assert family.documentation
        assert family.type in {"gauge", "counter"}
        for sample in family.samples:
            of_name = found.setdefault(sample.name, {"labels": set(), "values": []})
            of_name["labels"] |= sample.labels.keys()
            of_name["values"].append(sample.value)
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
