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


DIAGNOSIS = EncodedMessage("rwa/a/b/diagnosis", "rwa.Diagnosis", b'{"a":1.0}')
JUMPS = EncodedMessage("rwa/a/b/changepoints", "rwa.Changepoints", b"{}")
HASHES = b'{"provenance":{"prior_sha256":"a","wheel_sha256":"w"},"value":1.0}'


@pytest.mark.parametrize(
    ("recorded", "replayed", "fields", "compared", "bytes_equal"),
    [
        ([DIAGNOSIS, JUMPS], [DIAGNOSIS, JUMPS], {}, 2, True),
        ([DIAGNOSIS, JUMPS], [DIAGNOSIS], {"length": 1}, 1, False),
        ([DIAGNOSIS, JUMPS], [JUMPS, DIAGNOSIS], {"type": 1}, 0, False),
        ([DIAGNOSIS], [DIAGNOSIS._replace(payload=b'{"a": 1.00}')], {}, 1, False),
        # Whole numbers are exact.
        (*([DIAGNOSIS._replace(payload=b'{"a":%d}' % (10**18 + more))] for more in (0, 1)), {"a": 1}, 1, False),
        # A hash of floats may differ where the floats agree.
        *(
            ([DIAGNOSIS._replace(payload=HASHES)], [DIAGNOSIS._replace(payload=other)], fields, 1, False)
            for other, fields in (
                (HASHES.replace(b'"a"', b'"b"').replace(b"1.0", b"1.0000000000001"), {}),
                (HASHES.replace(b'"w"', b'"v"'), {"provenance.wheel_sha256": 1}),
            )
        ),
    ],
)
def test_length_order_type_content_and_bytes_are_compared(
    recorded: list[EncodedMessage],
    replayed: list[EncodedMessage],
    fields: dict[str, int],
    compared: int,
    bytes_equal: bool,
) -> None:
    report = Report()
    report.compare(recorded, replayed)
    assert (report.fields, sum(report.compared.values()), report.bytes_equal) == (fields, compared, bytes_equal)
