"""The comparator: it must find what differs, and nothing else."""

import json
from typing import Any

import hypothesis.strategies as st
from hypothesis import assume, given

from rwa_monitor.messages import EncodedMessage
from rwa_monitor.monitor.replay import RELATIVE_TOLERANCE, Report, differences

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
    assert compare([one, two], [one, two]).found == []
    assert [difference.path for difference in compare([one, two], [one]).found] == ["length"]
    swapped = compare([one, two], [two, one])
    assert [difference.path for difference in swapped.found] == ["type"]
    assert sum(swapped.compared.values()) == 0


def test_equal_content_in_other_bytes_is_equal_but_not_in_bytes() -> None:
    left, right = EncodedMessage("k", "s", b'{"a":1.0}'), EncodedMessage("k", "s", b'{"a": 1.00}')
    result = compare([left], [right])
    assert result.found == []
    assert not result.bytes_equal
    assert compare([left], [left]).bytes_equal


def test_a_hash_of_floats_may_differ_where_the_floats_agree() -> None:
    left = EncodedMessage("k", "s", b'{"provenance":{"prior_sha256":"a","wheel_sha256":"w"},"value":1.0}')
    right = EncodedMessage("k", "s", b'{"provenance":{"prior_sha256":"b","wheel_sha256":"w"},"value":1.0000000000001}')
    assert compare([left], [right]).found == []
    assert not compare([left], [right]).bytes_equal
    other = EncodedMessage("k", "s", right.payload.replace(b'"w"', b'"v"'))
    assert [difference.path for difference in compare([left], [other]).found] == ["provenance.wheel_sha256"]
