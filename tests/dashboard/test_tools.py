"""What other tools get: metrics and alert rules for Prometheus, a dashboard file for Grafana."""

import json
import re
import shutil
import subprocess
from collections import defaultdict
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import urlencode

import pytest
import zenoh
from prometheus_client.parser import text_string_to_metric_families

from rwa_monitor.dashboard.server import DashboardOptions, Running, serve
from rwa_monitor.messages import Diagnosis
from rwa_monitor.monitor.recording import read_chain
from tests.dashboard.support import acknowledge, ask, expect, opened, reporting, send_windows
from tests.dashboard.support import metrics as prometheus
from tests.docs.test_commands import ROOT
from tests.history.support import diagnosis
from tests.monitor.processes import wait_for

GRAFANA = Path("docs/integrations/grafana.json")
RULES = Path("docs/integrations/prometheus_rules.yml")

pytestmark = pytest.mark.processes


@pytest.fixture
def metrics(session: zenoh.Session, tmp_path: Path) -> Iterator[str]:
    with (
        serve(DashboardOptions(0, tmp_path), session) as running,
        reporting(session, "wheel_1", "wheel_2", samples_used=7, slots_missed=2),
    ):
        send_windows(session, "wheel_1", failing=False)
        send_windows(session, "wheel_2", failing=True)
        both = diagnosis(3, wheel="wheel_1")
        dry = both.anomalies["viscous"].model_copy(update={"estimate": 1.6e-3, "unit": "N m"})
        both = both.model_copy(update={"anomalies": {"dry": dry, **both.anomalies}})
        session.put("rwa/sat/wheel_1/diagnosis", both.to_json())

        text = partial(prometheus, running.address)
        wait_for(lambda: 'level="warning",phase="active"} 1.0' in text(), "the alarm in the metrics")
        wait_for(lambda: text().count("rwa_monitor_slots_missed_total{") == 2, "both monitors in the metrics")
        wait_for(lambda: 'part="dry"' in text(), "the latest window in the metrics")
        yield text()


def test_the_metrics_are_in_prometheus_format_and_hold_what_is_known(metrics: str) -> None:
    values = defaultdict(list)
    for family in text_string_to_metric_families(metrics):  # Prometheus's own parser
        assert family.documentation
        assert family.type in {"gauge", "counter"}
        for sample in family.samples:
            values[sample.name].append(sample.value)
    assert sum(values["rwa_wheel_verdict"]) == 2
    assert sorted(values["rwa_wheel_severity"]) == [0.0, 0.0, 1.0]
    assert values["rwa_monitor_slots_missed_total"] == [2.0, 2.0]
    assert sum(values["rwa_monitor_samples_total"]) == 14.0
    assert all(value < 20.0 for value in values["rwa_monitor_status_age_seconds"])


# Of each kind of object in a dashboard's file: the keys that Grafana asks for, and others of its that ours may have.
KEYS = {
    "board": ("title uid schemaVersion templating annotations panels time", "version editable refresh tags"),
    "panel": ("id type title datasource gridPos targets", "description fieldConfig options"),
    "target": ("refId datasource expr legendFormat", "instant"),
    "variable": ("name type query", "label datasource refresh multi includeAll allValue"),
}


def test_grafanas_file_is_valid_by_its_schema() -> None:
    board = json.loads(GRAFANA.read_text())
    panels, variables = board["panels"], board["templating"]["list"]
    targets = [target for panel in panels for target in panel["targets"]]
    for kind, objects in (("board", [board]), ("panel", panels), ("target", targets), ("variable", variables)):
        required, others = (set(names.split()) for names in KEYS[kind])
        for one in objects:
            assert required <= one.keys() <= required | others, one
    sources = [one["datasource"] for one in (*panels, *targets, *variables) if "datasource" in one]
    assert all(one == {"type": "prometheus", "uid": "${source}"} for one in sources)
    assert {panel["type"] for panel in panels} == {"stat", "timeseries"}
    assert len({panel["id"] for panel in panels}) == len(panels) > 5
    for place in (panel["gridPos"] for panel in panels):
        assert place.keys() == set("xywh")
        assert 0 <= place["x"] < place["x"] + place["w"] <= 24
    assert re.fullmatch(r"[a-zA-Z0-9_-]{1,40}", board["uid"])


# ---- by Prometheus's own tool ----------------------------------------------------------------------------------------


def promtool(*words: str, **files: Any) -> None:
    """Run promtool, as rules or tests of rules written to files; skips where there is none."""
    if shutil.which("promtool") is None:
        pytest.skip("no promtool: apt-get install prometheus")
    for name, content in files.items():
        Path(name).write_text(json.dumps(content))  # JSON is YAML
    done = subprocess.run(["promtool", *words], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def series(text: str) -> list[dict[str, str]]:
    """Return what was scraped as input for tests of rules: ten minutes of the same."""
    found = []
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            labels = ",".join(f"{name}={json.dumps(value)}" for name, value in sample.labels.items())
            found.append({"series": f"{sample.name}{{{labels}}}", "values": f"{sample.value:.9f}+0x10"})
    return found


def test_promtool_evaluates_every_expression_of_grafanas_file_on_what_is_exported(
    metrics: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = json.loads(GRAFANA.read_text())
    asked = [target["expr"] for panel in board["panels"] for target in panel["targets"]]
    asked = [re.sub(r"\$\w+", ".*", one) for one in asked]
    monkeypatch.chdir(tmp_path)
    checks = [
        {"expr": f"count({one}) > bool 0", "eval_time": "8m", "exp_samples": [{"labels": "{}", "value": 1}]}
        for one in asked
    ]
    test = {"interval": "1m", "input_series": series(metrics), "promql_expr_test": checks}
    promtool("test", "rules", "board", board={"evaluation_interval": "1m", "tests": [test]})
    rules = [{"record": f"rwa:panel:{number}", "expr": one} for number, one in enumerate(asked)]
    promtool("check", "rules", "rules", rules={"groups": [{"name": "board", "rules": rules}]})
    assert len(asked) > 10


def test_alert_rules_fire_when_they_should_and_not_before(
    metrics: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rules = str(RULES.resolve())
    monkeypatch.chdir(tmp_path)
    promtool("check", "rules", rules)

    def fires(input_series: list[dict[str, str]], **expected: int) -> dict[str, Any]:
        names = ("WheelAlarm", "WheelTelemetryStale", "WheelMonitorSilent", "DashboardGone")
        counts = [
            {"expr": f'count(ALERTS{{alertname="{name}", alertstate="firing"}}) or vector(0)', "eval_time": "8m"}
            | {"exp_samples": [{"labels": "{}", "value": expected.get(name, 0)}]}
            for name in names
        ]
        return {"interval": "1m", "input_series": input_series, "promql_expr_test": counts}

    def of(name: str, value: int) -> dict[str, str]:
        return {"series": f'{name}{{spacecraft="s",wheel="w"}}', "values": f"{value}x10"}

    quiet = [one for one in series(metrics) if not one["series"].startswith("rwa_alarms")]
    age, limit = (f"rwa_wheel_telemetry_{what}_seconds" for what in ("age", "stale_after"))
    tests = [
        fires(quiet),
        fires(series(metrics), WheelAlarm=1),
        fires([*quiet, of(age, 60), of(limit, 60), of("rwa_monitor_status_age_seconds", 30)]),
        fires([*quiet, of(age, 61), of(limit, 60)], WheelTelemetryStale=1),
        fires([*quiet, of("rwa_monitor_status_age_seconds", 31)], WheelMonitorSilent=1),
        fires([], DashboardGone=1),
    ]
    promtool("test", "rules", "alerts", alerts={"rule_files": [rules], "evaluation_interval": "1m", "tests": tests})


# ---- the Open MCT plugin in a real browser ---------------------------------------------------------------------------


PLUGIN = ROOT / "docs/integrations/openmct"
INSTALLED = ROOT / "build/openmct/node_modules"
MOST_LINES = 300
GOOD, BAD = (f"#/browse/rwa:fleet/rwa:{wheel}/rwa:{wheel}" for wheel in ("sat,wheel_1", "reference,wheel_1"))
FAULTS = "#/browse/faults.taxonomy:faultManagement.view"


@pytest.fixture
def origin(tmp_path: Path) -> Iterator[str]:
    """Serve the plugin's folder, Open MCT installed in it as `npm install` does there."""
    if not (INSTALLED / "openmct/dist/openmct.js").exists():
        pytest.skip("no Open MCT in build/openmct: apt-get install npm, then make openmct")
    folder = tmp_path / "openmct"
    shutil.copytree(PLUGIN, folder)
    (folder / "node_modules").symlink_to(INSTALLED)
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(SimpleHTTPRequestHandler, directory=str(folder))) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def test_the_plugin_is_short() -> None:
    assert len((PLUGIN / "plugin.js").read_text().splitlines()) <= MOST_LINES


@pytest.mark.browser
def test_open_mct_shows_wheels_verdicts_limits_and_alarms(
    chromium: Any, session: zenoh.Session, origin: str, tmp_path: Path
) -> None:
    """A wheel that is well, and one of a recording, with the diagnoses that a monitor made."""
    (recording,) = read_chain(ROOT / "replay/two_anomalies")
    *earlier, last = recording.parsed(Diagnosis)
    options = DashboardOptions(0, tmp_path / "records", token="right", silent_s=0.0, allow_origin=origin)
    with serve(options, session) as running:
        send_windows(session, "wheel_1", failing=False)
        for one in earlier:
            session.put("rwa/reference/wheel_1/diagnosis", one.to_json())
        wait_for(lambda: len(ask(running.address, "api/wheels/reference/wheel_1/windows")[1]) == 3, "the windows")
        with opened(chromium) as page:
            start = f"{origin}/?{urlencode({'server': running.address.rstrip('/'), 'days': 40_000})}"
            page.goto(start)
            tree = page.get_by_role("tree", name="Main Tree")
            tree.get_by_role("treeitem", name="Reaction wheels").get_by_label("Expand").click()
            expect(tree.get_by_role("treeitem", name="sat/wheel_1")).to_be_visible()
            tree.get_by_role("treeitem", name="reference/wheel_1").get_by_label("Expand").click()
            for part in ("dry", "viscous", "fss_1", "fss_2"):
                expect(tree.get_by_role("treeitem", name=f"Friction of wheel_1: {part}")).to_be_visible()

            page.goto(f"{start}{BAD},verdict?view=table")  # history, from the API
            rows = page.locator(".c-telemetry-table__body tbody tr")
            expect(rows.filter(has_text="anomalous")).to_have_count(3)
            for row in rows.all():
                assert "is-limit--red" in row.get_attribute("class")
            expect(rows.filter(has_text=earlier[0].reason)).to_have_count(1)
            session.put("rwa/reference/wheel_1/diagnosis", last.to_json())
            expect(rows).to_have_count(4)  # live, from the feed

            page.goto(f"{start}{BAD},viscous?view=table")
            expect(page.get_by_role("columnheader", name="Nominal to", exact=True)).to_be_visible()
            expect(rows).to_have_count(4)
            limits = [re.findall(r"is-limit--\w+", row.get_attribute("class") or "") for row in rows.all()]
            # Above its range once, and never called anomalous.
            assert sorted(limits) == [[], [], [], ["is-limit--upr", "is-limit--yellow"]]
            page.goto(f"{start}{BAD},fss_1?view=table")
            expect(page.locator("h1, .l-browse-bar__object-name", has_text="fss_1")).to_be_visible()
            expect(rows.filter(has_text=f"{last.anomalies['fss_1'].estimate:.5g}")).to_have_class(
                re.compile("is-limit--red")
            )
            page.goto(f"{start}{GOOD},verdict?view=table")
            expect(rows.filter(has_text="All friction is nominal.")).to_have_count(3)
            assert "is-limit" not in " ".join(row.get_attribute("class") or "" for row in rows.all())

            page.goto(f"{start}{FAULTS}")
            fault = page.get_by_role("listitem").filter(has_text="fss_1 of wheel_1")
            (alarm,) = (one for one in ask(running.address, "api/alarms")[1] if one["name"] == "fss_1")
            expect(fault.get_by_label("Live Value")).to_have_text(alarm["level"])
            expect(fault).to_have_class(re.compile("is-unacknowledged"))
            assert acknowledge(running.address, alarm["id"]) == 200  # on the dashboard; the feed brings it to Open MCT
            expect(fault).to_have_class(re.compile("is-acknowledged"))

            session.put("rwa/sat/wheel_7/diagnosis", diagnosis(0, wheel="wheel_7").to_json())
            expect(tree.get_by_role("treeitem", name="sat/wheel_7")).to_be_visible()


@pytest.mark.parametrize("options", [{"allow_origin": "http://127.0.0.1:8080"}])
def test_another_origin_reads_if_it_is_allowed_and_changes_nothing(dashboard: Running) -> None:
    origin = "http://127.0.0.1:8080"
    assert ask(dashboard.address, "api/fleet", headers={"Origin": origin})[0] == 200
    for other in ("http://127.0.0.1:8081", "http://127.0.0.1:8080.example", "null", ""):
        assert ask(dashboard.address, "api/fleet", headers={"Origin": other})[0] == 403
    right = {"Origin": origin, "Authorization": "Bearer right"}
    path = "api/alarms/1/acknowledge"
    assert ask(dashboard.address, path, headers=right, body=b'{"name":"Ann"}')[0] == 403
