"""docs/publish.md: its publisher reaches a monitor that comes late, its reader shows that, and its figures are true."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from rwa_monitor.messages import MAX_MESSAGE_BYTES, Status
from rwa_monitor.monitor.bus import HISTORY_MESSAGES, BusOptions, open_session
from rwa_monitor.monitor.ingest import HOLD_BACK_MESSAGES
from tests.docs.test_commands import ROOT, blocks_of
from tests.monitor.processes import Listener, process, wait_for
from tests.monitor.support import free_port

PAGE = ROOT / "docs" / "publish.md"


def _file(name: str, folder: Path) -> Path:
    """Write a file that the page shows."""
    (block,) = (block for block in blocks_of(PAGE) if block.mark == f"file {name}")
    path = folder / name
    path.write_text(block.text, encoding="utf-8")
    return path


@pytest.mark.processes
def test_the_publisher_of_the_page_loses_nothing_to_a_monitor_that_comes_late(tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    publisher = [sys.executable, str(_file("publisher.py", tmp_path)), endpoint]
    watch = [sys.executable, str(_file("watch.py", tmp_path)), endpoint]
    with (
        open_session(BusOptions(mode="router", listen=(endpoint,))) as session,
        subprocess.Popen(publisher, stdout=subprocess.PIPE, text=True) as sender,
    ):
        assert [next(sender.stdout).strip() for _ in range(2)] == ["sent 1", "sent 2"]  # nobody listens yet
        listener = Listener(session)
        with process("run", "-m", "client", "-e", endpoint, "--wheels", "rwa/sat-1/*/samples"):
            wait_for(lambda: bool(listener.status().get("samples_used")), "samples")
            with subprocess.Popen(watch, stdout=subprocess.PIPE, text=True) as reader:
                seen = next(reader.stdout)
                reader.kill()
            sender.terminate()
            sent = 8 * int(sender.stdout.read().split()[-1])
            wait_for(lambda: listener.status()["samples_received"] == sent, "the rest")
            status = listener.status()
        assert sender.wait(timeout=20) == 0
    assert re.match(r"rw-1 \{'samples_received': \d+, 'samples_used': \d+\} None", seen), seen
    assert status["samples_used"] == status["samples_received"]  # from the first one on
    assert (status["slots_missed"], status["messages_missed"], status["last_error"]) == (0, 0, None)


def test_the_figures_of_the_page_are_those_of_the_code() -> None:
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert f"max_samples={HISTORY_MESSAGES:_}" in text
    assert HOLD_BACK_MESSAGES == 4
    assert "(up to four may overtake one)" in text
    assert f"at most {MAX_MESSAGE_BYTES >> 20} MiB and 100,000 samples" in text


def test_operators_find_every_counter_of_the_status_explained() -> None:
    properties = Status.json_schema()["properties"].items()
    counters = {name for name, one in properties if one.get("type") == "integer" and not name.endswith("_ns")}
    assert len(counters) > 10, json.dumps(sorted(counters))
    page = (ROOT / "docs" / "operators.md").read_text(encoding="utf-8").split("## Is the monitor itself well?")[1]
    heads = [row.split(" | ")[0] for row in page.splitlines() if row[:2] == "| "]
    explained = set(re.findall(r"`(\w+)`", " ".join(heads)))
    assert counters <= explained, f"no row for {sorted(counters - explained)}"
