"""The content of a file as bytes, of which no more than a piece lies in memory."""

from __future__ import annotations

from errno import EIO
from io import FileIO
from operator import index
from typing import Protocol, SupportsIndex, overload

from rwa_monitor.telemetry.files import PIECE_BYTES


class Content(Protocol):
    """What a reader needs of a file's content; `bytes` and `FileBytes` are such."""

    def __len__(self) -> int: ...

    @overload
    def __getitem__(self, key: SupportsIndex, /) -> int: ...

    @overload
    def __getitem__(self, key: slice, /) -> bytes: ...

    def find(self, sub: bytes, start: int, /) -> int: ...


class FileBytes:
    """The content of a file as if it were in memory, of which only a piece is."""

    def __init__(self, file: FileIO, size: int) -> None:
        self._file = file
        self._size = size
        self._begin = 0
        self._piece = b""

    def __len__(self) -> int:
        return self._size

    @overload
    def __getitem__(self, key: SupportsIndex, /) -> int: ...

    @overload
    def __getitem__(self, key: slice, /) -> bytes: ...

    def __getitem__(self, key: SupportsIndex | slice, /) -> int | bytes:
        if not isinstance(key, slice):
            return self._between(index(key), index(key) + 1)[0]
        start, stop, _ = key.indices(self._size)
        return self._between(start, max(start, stop))

    def find(self, sub: bytes, start: int, /) -> int:
        """Return where some bytes are found first from `start` on, -1 where they are not."""
        while start + len(sub) <= self._size:
            stop = min(start + PIECE_BYTES, self._size)
            if (found := self._between(start, stop).find(sub)) >= 0:
                return start + found
            start = stop - len(sub) + 1  # what is looked for may lie across the border
        return -1

    def _between(self, start: int, stop: int) -> bytes:
        if not self._begin <= start <= stop <= self._begin + len(self._piece):
            self._file.seek(start)
            self._begin, self._piece = start, self._read(max(stop - start, min(PIECE_BYTES, self._size - start)))
        return self._piece[start - self._begin : stop - self._begin]

    def _read(self, count: int) -> bytes:
        pieces = []
        while count > 0:
            piece = self._file.read(count)
            if not piece:
                raise OSError(EIO, "it became shorter while it was read")
            pieces.append(piece)
            count -= len(piece)
        return pieces[0] if len(pieces) == 1 else b"".join(pieces)
