"""The Open MCT plugin in a real browser: a real Open MCT on a real dashboard."""

import re
import shutil
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import urlencode

import pytest
import zenoh

from rwa_monitor.dashboard.server import DashboardOptions, serve
from rwa_monitor.messages import Diagnosis
from rwa_monitor.monitor.recording import read_chain
from tests.dashboard.support import acknowledge, ask, expect, opened, send_windows
from tests.docs.test_commands import ROOT
from tests.history.support import diagnosis
from tests.monitor.processes import wait_for

PLUGIN = ROOT / "docs/integrations/openmct"
INSTALLED = ROOT / "build/openmct/node_modules"
MOST_LINES = 300
GOOD, BAD = (f"#/browse/rwa:fleet/rwa:{wheel}/rwa:{wheel}" for wheel in ("sat,wheel_1", "reference,wheel_1"))
FAULTS = "#/browse/faults.taxonomy:faultManagement.view"


class Quiet(SimpleHTTPRequestHandler):
    """Serves a folder, and logs nothing."""

    def log_message(self, *arguments: Any) -> None:
        pass


@pytest.fixture
def origin(tmp_path: Path) -> Iterator[str]:
    """Serve the plugin's folder, Open MCT installed in it as `npm install` does there."""
    if not (INSTALLED / "openmct/dist/openmct.js").exists():
        pytest.skip("no Open MCT in build/openmct: apt-get install npm, then make openmct")
    folder = tmp_path / "openmct"
    shutil.copytree(PLUGIN, folder)
    (folder / "node_modules").symlink_to(INSTALLED)
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder))) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def test_the_plugin_is_short() -> None:
    assert len((PLUGIN / "plugin.js").read_text().splitlines()) <= MOST_LINES


@pytest.mark.browser
@pytest.mark.processes
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
            limits = sorted(
                " ".join(re.findall(r"is-limit--\w+", row.get_attribute("class") or "")) for row in rows.all()
            )
            assert limits == [
                "",
                "",
                "",
                "is-limit--upr is-limit--yellow",
            ]  # above its range once, and never called anomalous
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


def test_another_origin_reads_if_it_is_allowed_and_changes_nothing(session: zenoh.Session, tmp_path: Path) -> None:
    origin = "http://127.0.0.1:8080"
    with serve(DashboardOptions(0, tmp_path, token="right", allow_origin=origin), session) as running:
        assert ask(running.address, "api/fleet", headers={"Origin": origin})[0] == 200
        for other in ("http://127.0.0.1:8081", "http://127.0.0.1:8080.example", "null", ""):
            assert ask(running.address, "api/fleet", headers={"Origin": other})[0] == 403
        right = {"Origin": origin, "Authorization": "Bearer right"}
        path = "api/alarms/1/acknowledge"
        assert ask(running.address, path, headers=right, body=b'{"name":"Ann"}')[0] == 403
