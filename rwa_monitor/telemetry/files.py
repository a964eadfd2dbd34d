"""Reading and writing files: with a size limit that is checked before anything is parsed, and never half-written.

Chunks of MCAP files (our recordings and ROS 2 bags) are unpacked here, after their sizes are checked.
"""

import csv
import os
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from hashlib import sha256
from io import BufferedReader, BytesIO, StringIO
from pathlib import Path
from typing import Final, cast

import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk

from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.wheel.file_content import MAX_CONTENT_BYTES

PathLike = str | os.PathLike[str]

SHA256_SUFFIX: Final = ".sha256"  # of a file as `sha256sum` writes it: the hash, then a name
MAX_DEPTH: Final = 64  # levels of nesting in a file: of text, containers, types
PIECE_BYTES: Final = 2**20  # read at once from a file that does not state its size


def display_name(path: PathLike) -> str:
    """Return a file's name for messages and fields: as given, with bytes that are not UTF-8 replaced."""
    return os.fsencode(path).decode("utf-8", "replace")


def companion_file(recording: Path, suffix: str) -> Path:
    """Return the name of a file that belongs to a recording: its own name with a suffix added."""
    return recording.with_name(recording.name + suffix)


@contextmanager
def opened(path: Path, buffering: int = -1) -> Iterator[BufferedReader]:
    """Open a file for reading; system errors in the block are raised as by `refusing`."""
    with refusing(path), path.open("rb", buffering) as file:
        yield cast("BufferedReader", file)


def read_bytes(path: Path, limit: int) -> bytes:
    """Return a file's content.

    Parameters
    ----------
    path
        The file.
    limit
        Largest size that is accepted [bytes]; little more than that is ever read.

    Raises
    ------
    InputError
        If the file cannot be read or is larger than `limit`.
    """
    with opened(path) as file:
        pieces, size = list[bytes](), os.fstat(file.fileno()).st_size
        # A file that states its size is refused by it; one that does not (a pipe, a device) is read up to the limit in
        # pieces, because Python allocates memory for the whole requested size before it reads.
        while size <= limit and (piece := file.read(PIECE_BYTES if pieces else max(size, PIECE_BYTES))):
            pieces.append(piece)
            size = sum(map(len, pieces))
    if size > limit:
        raise InputError(display_name(path), f"is larger than the limit of {limit:,} bytes")
    return b"".join(pieces)


def read_text(file: PathLike, limit: int) -> str:
    """Return the content of a UTF-8 file; its hash is checked if `<file>.sha256` exists.

    Raises
    ------
    InputError
        As `read_bytes`; if the hash file cannot be read, or its first word is not the hash of the content.
    """
    path = Path(file)
    content = read_bytes(path, limit)
    hash_file = companion_file(path, SHA256_SUFFIX)
    if hash_file.exists():
        stated = read_bytes(hash_file, MAX_CONTENT_BYTES).split(maxsplit=1)
        if not stated or stated[0].decode("ascii", "replace").lower() != sha256(content).hexdigest():
            raise InputError(display_name(path), f"is not the file whose hash stands in {display_name(hash_file)}")
    return decode_utf8(content, path)


def decode_utf8(content: bytes, path: Path) -> str:
    """Return the text of UTF-8 bytes.

    Raises
    ------
    InputError
        If the bytes are not UTF-8; names the row of the first that is not.
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        reason = f"is no UTF-8 text (byte 0x{content[error.start]:02x} at offset {error.start})"
        raise InputError(display_name(path), reason, f"row {row}") from error


def first_line(error: Exception) -> str:
    """Return the first line of the message of a library's error, its name where that is empty."""
    return next(iter(str(error).splitlines()), type(error).__name__)


@contextmanager
def refusing(path: Path, what: str = "cannot be read", place: str = "") -> Iterator[None]:
    """Convert an OSError in the block to an InputError with its reason, and with the option `place`.

    For a folder where a file is needed, the message names files in it.
    """
    try:
        yield
    except IsADirectoryError as error:
        inside = [name for pattern in ("*.mcap", "*.csv", "*.parquet") for name in sorted(path.glob(pattern))]
        files = f": {display_name(inside[0])} …" if inside else ""
        raise InputError(display_name(path), f"is a folder; give the files in it{files}", place) from error
    except OSError as error:
        raise InputError(display_name(path), f"{what}: {error.strerror or error}", place) from error


def make_folder(folder: Path, place: str = "") -> None:
    """Make a folder where it is missing; raise InputError, with the option `place`, where that fails."""
    with refusing(folder, "cannot be made", place):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except FileExistsError as error:
            raise InputError(display_name(folder), "is a file; a folder is needed here", place) from error


@contextmanager
def atomic_write(path: Path, place: str = "") -> Iterator[Path]:
    """Yield a temporary file in the same folder to write to, which is renamed to `path` if the block succeeds.

    A reader finds the old file or the whole new one, never a part; after an exception nothing is left behind.

    Raises
    ------
    InputError
        If the folder does not exist or is not writable, with the option `place`: raised before any work is lost.
    RwaMonitorError
        If writing fails later, for instance because the disk is full.
    """
    # One name per process: a file left by a killed process is overwritten by the next one with its id, else ignored.
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    if path.is_dir():
        raise InputError(display_name(path), "is a folder, not a file to write to", place)
    with refusing(path, "cannot be written", place):
        part.touch()
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise RwaMonitorError(f"{display_name(path)}: writing failed: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)


def write_files(folder: Path, contents: Mapping[str, bytes], place: str = "") -> None:
    """Write files, by their names, into a folder that is made where it is missing; if a write fails, none is replaced.

    Raises
    ------
    InputError
        If the folder cannot be made or written to; names the option `place`.
    RwaMonitorError
        If writing fails later, for instance because the disk is full.
    """
    make_folder(folder, place)
    with ExitStack() as parts:
        for name, content in contents.items():
            parts.enter_context(atomic_write(folder / name, place)).write_bytes(content)


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 file at once; raises as `atomic_write` does."""
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def write_rows(path: Path, rows: Iterable[Iterable[str]]) -> None:
    """Write rows of texts as CSV, as `write_text` does."""
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    write_text(path, text.getvalue())


# ---- chunks of MCAP files --------------------------------------------------------------------------------------------


MAX_CHUNK_BYTES: Final = 64 * 2**20  # ours have some 64 kB, or one message of at most 8 MB; rosbag2's less than a MB
RECORD_HEAD: Final = struct.Struct("<BQ")  # opcode and length
MESSAGE_HEAD: Final = struct.Struct("<HIQQ")  # channel, sequence, time when it was logged and published [ns]
MESSAGE: Final = int(Opcode.MESSAGE)  # comparing with the enumeration takes as long as reading the record


def stream_of(record: bytes) -> ReadDataStream:
    """Return a stream of one record, so that no length in it can reach beyond the record."""
    return ReadDataStream(BytesIO(record))


def unpacked(chunk: Chunk) -> bytes:
    """Return the content of a chunk.

    Raises
    ------
    ValueError
        If it is larger than allowed or not as large as stated, before it is unpacked where the chunk or its frame
        states a size; if it has another checksum.
    """
    size = chunk.uncompressed_size
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"it unpacks to {size:,} bytes; the limit is {MAX_CHUNK_BYTES:,}")
    if chunk.compression == "":
        data = chunk.data
    elif chunk.compression == "zstd":
        # The decompressor uses the size in the frame, not the one that its caller gives.
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
    """Yield opcode and content of the records in a chunk; raise ValueError where one reaches beyond its end."""
    position = 0
    while position < len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, position)
        position += RECORD_HEAD.size + length
        if position > len(data):
            raise ValueError("a record in it reaches beyond its end")
        yield opcode, data[position - length : position]
