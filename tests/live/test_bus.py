"""The bus: secure defaults, a bounded inbox, options that are told when wrong."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.live.bus import BusOptions, Inbox, open_session, session_config


def setting(options: BusOptions, key: str) -> object:
    return json.loads(session_config(options).get_json(key))


def test_nothing_listens_and_nothing_is_searched_for_unless_told() -> None:
    options = BusOptions()
    assert setting(options, "mode") == "peer"
    assert setting(options, "listen/endpoints") == []
    assert setting(options, "connect/endpoints") == []
    assert setting(options, "scouting/multicast/enabled") is False
    assert setting(options, "scouting/gossip/enabled") is False
    assert setting(options, "transport/shared_memory/enabled") is False
    with open_session(options) as session:
        assert session.info.links() == []


def test_options_and_a_configuration_file_are_heard(tmp_path: Path) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(
        '{ mode: "client", connect: { endpoints: ["tcp/127.0.0.1:1"] }, scouting: { multicast: { enabled: true } } }'
    )
    options = BusOptions(config=file)
    assert setting(options, "mode") == "client"
    assert setting(options, "scouting/multicast/enabled") is True
    assert setting(options, "listen/endpoints") == []
    louder = BusOptions(config=file, mode="peer", connect=("tcp/127.0.0.1:2",), no_multicast_scouting=True)
    assert setting(louder, "mode") == "peer"
    assert setting(louder, "connect/endpoints") == ["tcp/127.0.0.1:2"]
    assert setting(louder, "scouting/multicast/enabled") is False


@pytest.mark.parametrize(
    ("options", "source"),
    [
        (BusOptions(connect=("nonsense",)), "--connect"),
        (BusOptions(listen=("tcp",)), "--listen"),
        (BusOptions(mode="client"), "--mode"),
        (BusOptions(config=Path("does-not-exist.json5")), "does-not-exist.json5"),
    ],
)
def test_a_wrong_option_is_told(options: BusOptions, source: str) -> None:
    with pytest.raises(InputError) as caught:
        open_session(options)
    assert caught.value.source == source
    assert "\n" not in str(caught.value)


def test_a_bus_that_cannot_be_reached_is_told() -> None:
    with pytest.raises(RwaMonitorError, match=r"127\.0\.0\.1:1"):
        open_session(BusOptions(mode="client", connect=("tcp/127.0.0.1:1",)))


def test_a_full_inbox_drops_and_counts() -> None:
    inbox = Inbox(max_messages=3, max_bytes=10)
    for number in range(5):
        inbox.put("key", bytes([number]))
    assert (len(inbox), inbox.dropped) == (3, 2)
    assert inbox.take() == ("key", b"\0")
    inbox.put("key", bytes(9))  # 2 bytes wait: 11 are too many
    assert inbox.dropped == 3
    inbox.put("key", bytes(8))
    assert [inbox.take() for _ in range(4)] == [("key", b"\1"), ("key", b"\2"), ("key", bytes(8)), None]
