"""Chunks of MCAP files, of our recordings and of ROS 2 bags: their sizes are compared before anything is unpacked."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Final

import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk

MAX_CHUNK_BYTES: Final = 64 * 2**20  # ours have some 64 kB, or one message of at most 8 MB; rosbag2's less than a MB
RECORD_HEAD: Final = struct.Struct("<BQ")  # opcode and length
MESSAGE_HEAD: Final = struct.Struct("<HIQQ")  # channel, sequence, time when it was logged and published [ns]
MESSAGE: Final = int(Opcode.MESSAGE)  # comparing an enumeration costs as much as reading the record


def stream_of(record: bytes) -> ReadDataStream:
    """Return the stream of one record: no length in it reaches beyond."""
    return ReadDataStream(BytesIO(record))


def unpacked(chunk: Chunk) -> bytes:
    """Return the content of a chunk.

    Raises
    ------
    ValueError
        If it is more than the chunk states or may be, before it is unpacked; if it has another checksum.
    """
    size = chunk.uncompressed_size
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"it unpacks to {size:,} bytes; the limit is {MAX_CHUNK_BYTES:,}")
    if chunk.compression == "":
        data = chunk.data
    elif chunk.compression == "zstd":
        # The decompressor goes by the frame, not by its caller.
        stated = zstandard.get_frame_parameters(chunk.data).content_size
        if stated not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            raise ValueError(f"its frame states {stated:,} bytes, it itself {size:,}")
        data = zstandard.decompress(chunk.data, size)
    elif chunk.compression == "lz4":
        data = LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    else:
        raise ValueError(f"its compression {chunk.compression[:20]!r} is not known")
    if len(data) != size:
        raise ValueError(f"it unpacks to another size than the {size:,} bytes it states")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("it has another checksum than it states")
    return bytes(data)


def records_in(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and content of the records in a chunk; raises ValueError where one reaches beyond its end."""
    position = 0
    while position < len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, position)
        position += RECORD_HEAD.size + length
        if position > len(data):
            raise ValueError("a record in it reaches beyond its end")
        yield opcode, data[position - length : position]
