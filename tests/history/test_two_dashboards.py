"""Two dashboards on one PostgreSQL: what is done on one is seen on the other, without a reload."""

from __future__ import annotations

import json

import pytest
from websockets.sync.client import ClientConnection, connect

from rwa_monitor.dashboard.server import DashboardOptions, serve
from rwa_monitor.history.store import History
from rwa_monitor.monitor.bus import BusOptions, open_session
from tests.dashboard.support import WAIT_S
from tests.dashboard.test_retired_wheels import retire
from tests.history.support import diagnosis

pytestmark = pytest.mark.processes


def next_event(feed: ClientConnection) -> str:
    """Return the next event of the list of wheels."""
    while True:
        for entry in json.loads(feed.recv(timeout=WAIT_S)):
            if entry["key"] == "rwa/sat/wheel_1/retirement":
                return str(entry["message"]["event"])


def test_a_wheel_that_is_retired_on_one_leaves_the_list_of_the_other(new_database: str) -> None:
    with History(new_database) as history:
        history.add(*[diagnosis(n, wheel="wheel_1") for n in range(2)])
    options = DashboardOptions(0, token="right", history=new_database)
    with (
        open_session(BusOptions()) as session,
        serve(options, session) as first,
        serve(options, session) as second,
        connect(first.address.replace("http", "ws") + "api/feed") as feed_of_first,
        connect(second.address.replace("http", "ws") + "api/feed") as feed_of_second,
    ):
        for feed in (feed_of_first, feed_of_second):
            feed.recv(timeout=WAIT_S)  # what is so far; what changes from now on is sent once
        assert retire(first, "wheel_1")[0] == 200
        assert next_event(feed_of_second) == "retired"
        assert retire(second, "wheel_1", back=True)[0] == 200
        assert [next_event(feed_of_first), next_event(feed_of_first)] == ["retired", "brought_back"]
