"""The bus: secure defaults, a bounded inbox, options that are refused when wrong."""

import json
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import closing
from operator import length_hint
from pathlib import Path
from threading import Thread
from typing import Literal

import pytest

from rwa_monitor.monitor.backfill import MAX_ASKED, PAUSES_S, TIMEOUT_S, Arrival, Backfill, Inbox
from rwa_monitor.monitor.bus import BusOptions, MonitorBus, messages_publisher, open_session, session_config
from tests.monitor.processes import wait_for
from tests.monitor.support import KEY, free_port

# Before which message, from which number on; what takes a message that was found, and the end.
Question = tuple[Arrival, int, Callable[[Arrival], None], Callable[[], None]]


def setting(options: BusOptions, key: str) -> object:
    return json.loads(session_config(options).get_json(key))


def settings_of(options: BusOptions, *keys: str) -> list[object]:
    return [setting(options, key) for key in keys]


def test_nothing_listens_and_nothing_is_searched_for_by_default() -> None:
    options = BusOptions()
    assert settings_of(options, "mode", "listen/endpoints", "connect/endpoints") == ["peer", [], []]
    scouting = ("scouting/multicast/enabled", "scouting/gossip/enabled", "transport/shared_memory/enabled")
    assert settings_of(options, *scouting) == [False] * 3
    with open_session(options) as session:
        assert session.info.links() == []


def test_options_and_a_configuration_file_count(tmp_path: Path) -> None:
    file, keys = tmp_path / "zenoh.json5", ("mode", "connect/endpoints", "scouting/multicast/enabled")
    file.write_text(
        '{ mode: "client", connect: { endpoints: ["tcp/127.0.0.1:1"] }, scouting: { multicast: { enabled: true } } }'
    )
    options = BusOptions(config=file)
    assert settings_of(options, *keys, "listen/endpoints") == ["client", ["tcp/127.0.0.1:1"], True, []]
    louder = BusOptions(config=file, mode="peer", connect=("tcp/127.0.0.1:2",), no_multicast_scouting=True)
    assert settings_of(louder, *keys) == ["peer", ["tcp/127.0.0.1:2"], False]


def test_a_full_inbox_drops_and_counts() -> None:
    inbox = Inbox()
    inbox.max_messages, inbox.max_bytes, inbox.max_wait_s = 3, 10, 0.01
    for number in range(5):
        inbox.put(Arrival("key", bytes([number])))
    assert (len(inbox), inbox.dropped) == (3, 2)
    assert inbox.take() == Arrival("key", b"\0")
    inbox.put(Arrival("key", bytes(9)))  # 2 bytes wait: 11 are too many
    assert inbox.dropped == 3
    inbox.put(Arrival("key", bytes(8)))
    left = [inbox.take() for _ in range(4)]
    assert left == [Arrival("key", b"\1"), Arrival("key", b"\2"), Arrival("key", bytes(8)), None]


def test_a_full_inbox_slows_down_who_puts_and_loses_nothing() -> None:
    inbox = Inbox()
    inbox.max_messages, inbox.max_wait_s = 3, 30.0
    thread = Thread(target=lambda: [inbox.put(Arrival("key", bytes([number]))) for number in range(100)])
    thread.start()
    taken: list[int] = []
    while len(taken) < 100:
        message = inbox.take()
        if message is not None:
            taken.append(message.payload[0])
        assert len(inbox) <= 3
    thread.join()
    assert (taken, inbox.dropped) == (list(range(100)), 0)


# ---- what was sent before the first message that came ----------------------------------------------------------


class Asking(Backfill):
    """Closes gaps, with publishers that answer when the test lets them."""

    def __init__(self, max_bytes: int = 1_000) -> None:
        self.asked: list[Question] = []
        self.now_s = 0.0
        super().__init__(lambda *question: self.asked.append(question), max_bytes, lambda: self.now_s)

    def drain(self, waiting: Iterable[Arrival] = ()) -> list[Arrival]:
        """Return all that is passed on while messages wait in the inbox."""
        left = iter(waiting)
        return list(iter(lambda: self.take(lambda: next(left, None)), None))

    def answer(self, place: int, found: Iterable[Arrival] = ()) -> None:
        """Answer a question with messages."""
        for message in found:
            self.asked[place][2](message)
        self.asked[place][3]()


def arrivals(source: str, numbers: range) -> list[Arrival]:
    return [Arrival("key", b"payload", source, number) for number in numbers]


def test_a_publisher_that_appears_late_is_asked_for_what_it_sent_before_and_others_pass() -> None:
    backfill = Asking()
    late, other = arrivals("late", range(8)), arrivals("other", range(2))
    assert backfill.drain([late[5], other[0], late[6], other[1]]) == other
    ((before, first, found, finished),) = backfill.asked
    assert (before, first) == (late[5], 0)
    for message in (*late[3:5], *late[:4]):  # in any order, some twice
        found(message)
    assert (backfill.drain(), len(backfill)) == ([], 2)
    finished()
    assert backfill.drain([late[7]]) == late
    assert len(backfill.asked) == 1
    assert backfill.missed == {}


def test_a_gap_is_asked_for_again_until_it_is_closed() -> None:
    backfill = Asking()
    sent = arrivals("one", range(9))
    assert backfill.drain([*sent[:2], *sent[4:6], sent[8]]) == sent[:2]
    backfill.answer(0)  # with nothing: the connection is gone
    assert backfill.drain() == []
    backfill.now_s += PAUSES_S[0]
    assert backfill.drain() == []
    backfill.answer(1, sent[2:4])
    assert backfill.drain() == sent[2:6]  # and the next gap is found
    backfill.answer(2, sent[6:8])
    assert backfill.drain() == sent[6:]
    assert [(before.number, first) for before, first, _, _ in backfill.asked] == [(4, 2), (4, 2), (8, 6)]


def test_what_a_publisher_no_longer_has_costs_a_wait_and_is_counted() -> None:
    backfill = Asking()
    sent = arrivals("one", range(9))
    out = backfill.drain([sent[0], *sent[6:]])
    while backfill.now_s < 2.0 * (sum(PAUSES_S) + (len(PAUSES_S) + 1) * TIMEOUT_S):  # nobody answers
        backfill.now_s += 0.1
        out += backfill.drain()
    assert out == [sent[0], *sent[6:]]
    assert backfill.missed == {"key": 5}
    assert len(backfill.asked) == len(PAUSES_S) + 1


def test_what_waits_for_a_history_is_bounded() -> None:
    backfill = Asking(20)
    waiting = iter(arrivals("late", range(1, 100)))
    assert backfill.drain(waiting) == []
    assert length_hint(waiting) == 96  # 3 messages of 7 bytes are more than 20
    backfill.answer(0, arrivals("late", range(1)))
    assert backfill.drain(waiting) == arrivals("late", range(100))


def fleet_of(publishers: int, kept: int) -> dict[str, list[Arrival]]:
    """Return the messages of publishers that each keep some, and the one after them, which comes first."""
    return {f"publisher {number}": arrivals(f"publisher {number}", range(kept + 1)) for number in range(publishers)}


def test_of_a_fleet_a_few_publishers_are_asked_at_a_time_and_no_more_while_answers_lie_here() -> None:
    kept = 20
    backfill = Asking(500 * len(b"payload"))  # fewer than that many publishers keep
    fleet = fleet_of(200, kept)
    out = backfill.drain(sent[kept] for sent in fleet.values())
    answered = 0
    while len(out) < 200 * (kept + 1):
        asked = backfill.asked[answered:]
        assert 0 < len(asked) <= MAX_ASKED
        for before, first, *_ in asked:
            backfill.answer(answered, fleet[before.source][first:kept])
            answered += 1
        for _ in range(2 * kept):  # what two of them kept; the others' answers are still here
            out.append(backfill.take(lambda: None))
        assert len(backfill.asked) == answered
        out += backfill.drain()
    assert {source: [one for one in out if one.source == source] for source in fleet} == fleet
    assert (answered, backfill.missed, len(backfill)) == (200, {}, 0)


def test_a_publisher_is_asked_also_while_messages_of_others_flow() -> None:
    backfill = Asking()
    late, flowing = arrivals("late", range(3)), deque(arrivals("other", range(100)))
    flowing.insert(1, late[2])
    for _ in range(3):
        assert backfill.take(flowing.popleft) is not None
    assert [before.source for before, *_ in backfill.asked] == ["late"]


def test_publishers_that_do_not_answer_let_others_be_asked() -> None:
    backfill = Asking(10_000)
    fleet = fleet_of(3 * MAX_ASKED, 1)
    assert backfill.drain(sent[1] for sent in fleet.values()) == []
    assert len(backfill.asked) == MAX_ASKED
    backfill.now_s += TIMEOUT_S
    assert backfill.drain() == []
    assert {before.source for before, *_ in backfill.asked} == set(list(fleet)[: 2 * MAX_ASKED])


def test_what_could_not_be_read_may_be_followed_by_a_gap_that_was_found_before() -> None:
    backfill = Asking()
    sent = arrivals("one", range(9))
    assert backfill.drain([*sent[2:5], sent[7]]) == []
    backfill.answer(0, sent[:2])
    # The first is read while those after it lie ready, and the next gap is known.
    assert backfill.take(lambda: None) == sent[0]
    assert backfill.ask_again(sent[0])
    assert backfill.drain([sent[8]]) == []
    backfill.answer(-1, sent[:1])
    out = backfill.drain()
    assert out == [sent[0]._replace(again=True), *sent[1:5]]
    backfill.answer(-1, sent[5:7])
    assert backfill.drain() == sent[5:]
    assert (len(backfill), backfill.missed) == (0, {})


@pytest.mark.parametrize("answers", ["nobody", "without it", "as bad"])
def test_what_cannot_be_read_twice_is_given_out_as_it_is_and_its_publisher_not_asked_again(answers: str) -> None:
    backfill = Asking()
    sent = arrivals("one", range(5))
    assert backfill.drain(sent[:2]) == sent[:2]
    assert backfill.ask_again(sent[1])
    if answers == "nobody":
        backfill.now_s += TIMEOUT_S
    else:
        backfill.answer(0, [sent[1]] if answers == "as bad" else [])
    out = backfill.drain([sent[2]])
    assert out == [sent[1]._replace(again=True), sent[2]]
    assert not backfill.ask_again(out[0])
    assert not backfill.ask_again(out[1])
    assert backfill.drain(sent[3:]) == sent[3:]
    assert (len(backfill.asked), backfill.missed) == (1, {})


def test_one_that_comes_again_and_cannot_be_read_does_not_let_all_after_it_be_asked_for() -> None:
    backfill = Asking()
    sent = arrivals("one", range(8))
    assert backfill.drain(sent[:6]) == sent[:6]
    assert backfill.ask_again(sent[1])
    backfill.answer(0, [sent[1]])
    assert backfill.drain(sent[6:]) == [sent[1]._replace(again=True), *sent[6:]]
    assert (len(backfill.asked), backfill.missed) == (1, {})


def test_a_bus_whose_inbox_overflows_gets_everything_in_the_end() -> None:
    with open_session(BusOptions()) as session, closing(MonitorBus(session)) as bus:
        inbox = bus.inbox
        inbox.max_messages, inbox.max_wait_s = 5, 0.02
        bus.subscribe("rwa/*/*/samples")
        publisher = messages_publisher(session, KEY)
        for number in range(60):
            publisher.put(b"%d" % number)
        wait_for(lambda: len(bus.inbox) == 5, "the first messages")
        wait_for(lambda: bus.inbox.dropped == 55, "the others to be dropped")
        taken: list[int] = []

        def took_all() -> bool:
            while (message := bus.take()) is not None:
                taken.append(int(message.payload))
            return len(taken) >= 60

        wait_for(took_all, "all messages")
        publisher.undeclare()
    assert taken == list(range(60))
    assert bus.backfill.missed == {}


@pytest.mark.parametrize("mode", ["router", "peer"])
def test_those_who_only_connect_reach_each_other_through_whoever_listens(mode: Literal["router", "peer"]) -> None:
    """As peers behind a router they would be silently deaf to each other."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    only_connected = BusOptions(connect=(endpoint,))
    received: list[bytes] = []
    with (
        open_session(BusOptions(mode=mode, listen=(endpoint,))),
        open_session(only_connected) as one,
        open_session(only_connected) as other,
        one.declare_subscriber("rwa/**", lambda sample: received.append(sample.payload.to_bytes())),
        other.declare_publisher(KEY) as publisher,
    ):
        wait_for(lambda: bool(publisher.matching_status.matching), "a match")
        publisher.put(b"a message")
        wait_for(lambda: received == [b"a message"], "the message")
