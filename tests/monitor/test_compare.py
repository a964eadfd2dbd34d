"""The comparator: it must find what differs, and nothing else."""

import copy
import json
from typing import Any

import hypothesis.strategies as st
from hypothesis import assume, given

from rwa_monitor.messages import EncodedMessage
from rwa_monitor.monitor.replay import RELATIVE_TOLERANCE, Report, differences

LEAVES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(10**12), 10**12),
    st.floats(-1e12, 1e12).filter(lambda value: value == 0 or abs(value) > 1e-9),
    st.text(max_size=5),
)
CONTENT = st.recursive(
    LEAVES,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(min_size=1, max_size=4), inner, max_size=4),
    max_leaves=20,
)


def compare(recorded: list[EncodedMessage], replayed: list[EncodedMessage]) -> Report:
    """Return what a comparison finds."""
    report = Report()
    report.compare(recorded, replayed)
    return report


def leaves(content: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the paths of all leaves."""
    if isinstance(content, dict):
        return [leaf for key, value in content.items() for leaf in leaves(value, (*path, key))]
    if isinstance(content, list):
        return [leaf for key, value in enumerate(content) for leaf in leaves(value, (*path, key))]
    return [path]


def with_leaf(content: Any, path: tuple[Any, ...], value: Any) -> Any:
    if not path:
        return value
    changed = copy.deepcopy(content)
    holder = changed
    for key in path[:-1]:
        holder = holder[key]
    holder[path[-1]] = value
    return changed


def leaf(content: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        content = content[key]
    return content


@given(content=CONTENT, other=LEAVES, data=st.data())
def test_any_changed_leaf_is_found(content: Any, other: Any, data: st.DataObject) -> None:
    paths = leaves(content)
    assume(paths)
    path = data.draw(st.sampled_from(paths))
    value = leaf(content, path)
    assume(json.dumps(value) != json.dumps(other))
    # An integer and the float of the same value are one number in JSON.
    assume(isinstance(value, bool) or isinstance(other, bool) or value != other)
    numbers = (int, float)
    if isinstance(value, numbers) and isinstance(other, numbers):
        assume(abs(value - other) > 2 * RELATIVE_TOLERANCE * max(abs(value), abs(other)))
    found = list(differences(content, with_leaf(content, path, other)))
    assert [place for place, _, _ in found] == [".".join(str(part) for part in path)]
    # And the other way round.
    assert len(list(differences(with_leaf(content, path, other), content))) == 1


@given(content=CONTENT, share=st.floats(-0.9, 0.9), data=st.data())
def test_floats_may_differ_in_the_last_bits(content: Any, share: float, data: st.DataObject) -> None:
    paths = [path for path in leaves(content) if isinstance(leaf(content, path), float)]
    assume(paths)
    path = data.draw(st.sampled_from(paths))
    moved = leaf(content, path) * (1.0 + share * RELATIVE_TOLERANCE)
    assert list(differences(content, with_leaf(content, path, moved))) == []


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
