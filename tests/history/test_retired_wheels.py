"""Retired wheels: who did it, what hinders it, and that a wheel whose telemetry arrives is back once."""

import json
from pathlib import Path

import pytest
from websockets.sync.client import ClientConnection, connect

from rwa_monitor.dashboard.server import DashboardOptions, serve
from rwa_monitor.errors import InputError
from rwa_monitor.history.store import History
from rwa_monitor.monitor.bus import BusOptions, open_session
from tests.dashboard.support import WAIT_S
from tests.dashboard.test_retired_wheels import retire
from tests.history.support import diagnosis


def test_a_wheel_is_retired_and_back_and_every_event_is_kept(place: Path | str) -> None:
    clock = iter(range(1_000))
    with History(place, wall_ns=lambda: next(clock)) as history:
        history.add(*[diagnosis(0), diagnosis(1)])
        line = history.retired.change("sat", "wheel_1", "Ann", "retired", retire=True)
        assert (line.retired, line.person, line.time_ns) == (True, "Ann", diagnosis(1).window_end_ns)
        assert history.retired.latest() == [line]
        with pytest.raises(InputError, match="is retired already, by Ann"):
            history.retired.change("sat", "wheel_1", "Ben", retire=True)
        assert not history.retired.change("sat", "wheel_1", "Ben", retire=False).retired
        with pytest.raises(InputError, match="is not retired"):
            history.retired.change("sat", "wheel_1", "Ben", retire=False)
        again = history.retired.change("sat", "wheel_1", "Ann", retire=True)
        back = again.model_copy(update={"event": "telemetry_arrived", "person": ""})
        history.retired.record([back])
        history.retired.record([back])  # a second dashboard on the same database had its telemetry too
    with History(place) as history:
        events = [(line.event, line.person) for line in history.retired.events("sat", "wheel_1")]
        assert events == [("retired", "Ann"), ("brought_back", "Ben"), ("retired", "Ann"), ("telemetry_arrived", "")]
        assert [line.event for line in history.retired.latest()] == ["telemetry_arrived"]
        assert history.windows("sat", "wheel_1") == [diagnosis(0), diagnosis(1)]  # nothing of the wheel is removed


# ---- two dashboards on one database ----------------------------------------------------------------------------------


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
    options = DashboardOptions(0, Path("none"), token="right", history=new_database)
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
