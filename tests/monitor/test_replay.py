"""Replay: the references give again what they hold, and what was tampered with is found."""

import json
import shutil
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import pytest
from hypothesis import assume, given
from mcap.writer import Writer

from benchmarks import references
from rwa_monitor.errors import InputError
from rwa_monitor.messages import Diagnosis, EncodedMessage
from rwa_monitor.monitor.recorder import recover
from rwa_monitor.monitor.recording import recordings_of
from rwa_monitor.monitor.replay import RELATIVE_TOLERANCE, Report, differences, replay
from tests.monitor.recordings import rewrite
from tests.monitor.support import adds_up, recorded

REPLAY = Path(__file__).parents[2] / "replay"
BY_NAME = {reference.name: reference for reference in references.REFERENCES}


@pytest.mark.parametrize("name", BY_NAME)
def test_a_reference_gives_again_what_it_holds(name: str) -> None:
    report = replay(REPLAY / name)
    assert report.equal, report.long()
    assert report.unreadable == []
    assert report.compared["rwa.Diagnosis"] >= 3
    assert report.compared["rwa.Changepoints"] >= 10


def test_the_manifest_lists_what_the_references_hold_and_each_holds_what_it_is_for() -> None:
    manifest = json.loads((REPLAY / references.MANIFEST).read_text(encoding="utf-8"))["recordings"]
    assert {folder.name for folder in REPLAY.iterdir() if folder.is_dir()} == set(manifest) == set(BY_NAME)
    for name, written in manifest.items():
        seen = references.summary(REPLAY / name)
        assert written == {"about": BY_NAME[name].about, **seen}
        assert references.missing(BY_NAME[name], seen) == []


def test_the_same_code_makes_the_same_bytes(tmp_path: Path) -> None:
    for folder in (tmp_path / "one", tmp_path / "two"):
        references.make(BY_NAME["bad_day"], folder)
    assert references.summary(tmp_path / "one") == references.summary(tmp_path / "two")


def test_samples_add_up_in_every_status_of_the_bad_day() -> None:
    statuses = [json.loads(payload) for payload in recorded(REPLAY / "bad_day", "rwa.Status")]
    assert len(statuses) > 5
    assert all(map(adds_up, statuses))


# ---- what was tampered with ------------------------------------------------------------------------------------------


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the nominal reference."""
    shutil.copytree(REPLAY / "nominal", tmp_path / "copy")
    return next((tmp_path / "copy").glob("*.mcap"))


def test_a_changed_diagnosis_is_found_and_counted_by_field(copy: Path) -> None:
    def change(message: EncodedMessage) -> bytes:
        content = json.loads(message.payload)
        if message.schema == Diagnosis.schema_name():
            content["fit"]["rmse_Nm"] *= 1.0 + 1e-7
        return json.dumps(content).encode()

    rewrite(copy, copy, change)
    report = replay(copy)
    assert not report.equal
    assert report.fields == {"fit.rmse_Nm": 3}
    assert "3 × fit.rmse_Nm" in report.short()
    assert len(report.long().splitlines()) == 4


def test_a_recording_without_a_window_is_no_success(copy: Path) -> None:
    rewrite(copy, copy, lambda message: None)
    report = replay(copy)
    assert not report.equal
    assert "nothing could be compared" in report.short()
    assert any("no closed window" in note for note in report.notes)


def test_a_damaged_chunk_is_reported_and_the_rest_compared(copy: Path) -> None:
    data = copy.read_bytes()
    copy.write_bytes(data[: len(data) * 3 // 4])
    report = replay(copy)
    assert report.unreadable
    assert report.equal
    saved = copy.with_name("saved.mcap")
    recover(copy, saved)
    assert replay(saved).compared == report.compared


def test_a_chain_is_checked_link_by_link(tmp_path: Path) -> None:
    folder = tmp_path / "chain"
    shutil.copytree(REPLAY / "bad_day", folder)
    first, second = recordings_of(folder)
    assert replay([first, second]).equal
    swapped = replay([second, first])
    assert any("names no predecessor" in note for note in swapped.notes)
    # Each alone is sound as well: a recording begins with a checkpoint.
    assert replay(first).equal
    alone = replay(second)
    assert alone.equal
    assert any(first.name in note for note in alone.notes)
    first.write_bytes(first.read_bytes() + b"\0")
    touched = replay(folder)
    assert not touched.equal
    assert "is not the file" in touched.long()


def test_what_is_no_recording_of_ours_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(InputError, match=r"settings\.json"):
        replay(path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="holds no recording"):
        replay(tmp_path / "empty")


# ---- the comparator --------------------------------------------------------------------------------------------------


FLOATS = st.floats(-1e12, 1e12).filter(lambda value: value == 0 or abs(value) > 1e-9)
LEAVES = st.one_of(st.none(), st.booleans(), st.integers(-(10**12), 10**12), FLOATS, st.text(max_size=5))
KEYS = st.text(min_size=1, max_size=4)
CONTENT = st.recursive(
    LEAVES, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS, inner, max_size=4), max_leaves=10
)
# What a leaf lies in, from within to without: a key, and what stands beside it in a dictionary or a list.
AROUND = st.lists(
    st.tuples(KEYS, st.lists(CONTENT, max_size=3) | st.dictionaries(KEYS, CONTENT, max_size=3)), max_size=4
)
Around = list[tuple[str, list[Any] | dict[str, Any]]]


def compare(recorded: list[EncodedMessage], replayed: list[EncodedMessage]) -> Report:
    """Return what a comparison finds."""
    report = Report()
    report.compare(recorded, replayed)
    return report


def within(leaf: Any, around: Around) -> tuple[str, Any]:
    """Return the path of a leaf, and the content that it lies in."""
    path = []
    for key, beside in around:
        at = len(key) % (len(beside) + 1)
        path.insert(0, key if isinstance(beside, dict) else str(at))
        leaf = {**beside, key: leaf} if isinstance(beside, dict) else [*beside[:at], leaf, *beside[at:]]
    return ".".join(path), leaf


@given(value=LEAVES, other=LEAVES, around=AROUND)
def test_any_changed_leaf_is_found(value: Any, other: Any, around: Around) -> None:
    assume(json.dumps(value) != json.dumps(other))
    # An integer and the float of the same value are one number in JSON.
    assume(isinstance(value, bool) or isinstance(other, bool) or value != other)
    numbers = (int, float)
    if isinstance(value, numbers) and isinstance(other, numbers):
        assume(abs(value - other) > 2 * RELATIVE_TOLERANCE * max(abs(value), abs(other)))
    (path, content), (_, changed) = within(value, around), within(other, around)
    assert [place for place, _, _ in differences(content, changed)] == [path]
    # And the other way round.
    assert len(list(differences(changed, content))) == 1


@given(value=FLOATS, share=st.floats(-0.9, 0.9), around=AROUND)
def test_floats_may_differ_in_the_last_bits(value: float, share: float, around: Around) -> None:
    moved = value * (1.0 + share * RELATIVE_TOLERANCE)
    assert list(differences(within(value, around)[1], within(moved, around)[1])) == []


def test_whole_numbers_are_exact() -> None:
    assert list(differences({"time_ns": 10**18}, {"time_ns": 10**18 + 1})) == [("time_ns", 10**18, 10**18 + 1)]


def test_length_order_and_type_are_compared_before_content() -> None:
    one = EncodedMessage("rwa/a/b/diagnosis", "rwa.Diagnosis", b"{}")
    two = EncodedMessage("rwa/a/b/changepoints", "rwa.Changepoints", b"{}")
    assert compare([one, two], [one, two]).differences == []
    assert compare([one, two], [one]).fields == {"length": 1}
    swapped = compare([one, two], [two, one])
    assert swapped.fields == {"type": 1}
    assert sum(swapped.compared.values()) == 0


def test_equal_content_in_other_bytes_is_equal_but_not_in_bytes() -> None:
    left, right = EncodedMessage("k", "s", b'{"a":1.0}'), EncodedMessage("k", "s", b'{"a": 1.00}')
    result = compare([left], [right])
    assert result.differences == []
    assert not result.bytes_equal
    assert compare([left], [left]).bytes_equal


def test_a_hash_of_floats_may_differ_where_the_floats_agree() -> None:
    left = EncodedMessage("k", "s", b'{"provenance":{"prior_sha256":"a","wheel_sha256":"w"},"value":1.0}')
    right = EncodedMessage("k", "s", b'{"provenance":{"prior_sha256":"b","wheel_sha256":"w"},"value":1.0000000000001}')
    assert compare([left], [right]).differences == []
    assert not compare([left], [right]).bytes_equal
    other = EncodedMessage("k", "s", right.payload.replace(b'"w"', b'"v"'))
    assert compare([left], [other]).fields == {"provenance.wheel_sha256": 1}
