"""Bytes made from valid ones by a few edits: the inputs on which a parser is most likely to fail.

Edits of bytes, as a hypothesis strategy; edits of values in valid JSON, to test the code behind its parser.
"""

import json
import random
from collections.abc import Sequence
from typing import Any, Final

from hypothesis import strategies as st

TOKENS: Final = (
    b"", b"\x00", b"\xff", b"\xff" * 8, b"\x7f" + b"\xff" * 7, b"\x00" * 8, b"\n", b"\r\n", b",", b'"', b"'", b"[",
    b"]", b"{", b"}", b"=", b":", b".", b"-", b"0", b"1e999", b"-1", b"1e-400", b"nan", b"NaN", b"Infinity", b"null",
    b"true", b"9223372036854775807", b"-9223372036854775808", b"18446744073709551616", b"\xe2\x80\xae", b"\xed\xa0\x80",
    b"\\u0000", b'""\"', b"[[", b"..", b"../", b"PAR1", b"\x89MCAP0\r\n", b"\x04\x00\x00\x00zstd", b"[" * 2_000,
    b"a." * 200,
)  # fmt: skip


@st.composite
def mutated(draw: st.DrawFn, seeds: Sequence[bytes]) -> bytes:
    """Draw one of the seeds, changed in one to five places; occasionally random bytes."""
    if draw(st.integers(0, 19)) == 0:
        return draw(st.binary(max_size=200))
    data = bytearray(draw(st.sampled_from(list(seeds))))
    for _ in range(draw(st.integers(1, 5))):
        start = draw(st.integers(0, len(data)))
        stop = min(len(data), start + draw(st.sampled_from((0, 1, 1, 2, 4, 8, 8, 64, 10**9))))
        match draw(st.sampled_from(("token", "bytes", "cut", "again", "bit", "elsewhere"))):
            case "token":
                data[start:stop] = draw(st.sampled_from(TOKENS))
            case "bytes":
                data[start:stop] = draw(st.binary(max_size=16))
            case "cut":
                del data[start:stop]
            case "again":
                data[start:start] = data[start:stop] * draw(st.integers(1, 3))
            case "bit" if start < len(data):
                data[start] ^= 1 << draw(st.integers(0, 7))
            case "elsewhere":
                other = draw(st.sampled_from(list(seeds)))
                data[start:stop] = other[start : start + (stop - start)]
    return bytes(data[: 10**6])


VALUES: Final = (
    None, True, 0, 1, -1, 2, 0.5, -0.0, 1e-300, 1e300, 2**31, 2**53, 2**63, -(2**63), 2**64, 10**30, "", "x", "..",
    "a/b", "\x00", [], [0], {}, {"x": 1},
)  # fmt: skip


def other_json(data: bytes, seed: int) -> bytes | None:
    """Return JSON with some values changed, a byte before it as it was; None if it is no JSON."""
    rng = random.Random(seed)
    begin = 0 if data[:1] in b"{[" else 1
    try:
        content = json.loads(data[begin:])
    except (ValueError, RecursionError):
        return None
    for _ in range(rng.randint(1, 4)):
        content = _changed(content, rng)
    return data[:begin] + json.dumps(content, separators=(",", ":")).encode("utf-8", "surrogatepass")


def _changed(content: Any, rng: random.Random) -> Any:
    """Return a JSON value with one value in it changed, removed or duplicated."""
    if isinstance(content, dict) and content and rng.random() < 0.9:
        key = rng.choice(list(content))
        if rng.random() < 0.1:
            return {name: value for name, value in content.items() if name != key}
        if rng.random() < 0.05:
            return content | {rng.choice(("x", "__class__", f"{key}_")): content[key]}
        return content | {key: _changed(content[key], rng)}
    if isinstance(content, list) and content and rng.random() < 0.8:
        at = rng.randrange(len(content))
        if rng.random() < 0.2:
            return content[:at] + content[at + 1 :] + rng.choice(([], [content[at]] * 3))
        return [*content[:at], _changed(content[at], rng), *content[at + 1 :]]
    if isinstance(content, (int, float)) and rng.random() < 0.5:
        return rng.choice((content + 1, content - 1, -content, content * 2, content / 3, content * 1e6))
    return rng.choice(VALUES)
