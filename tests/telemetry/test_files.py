"""Files are read within a limit and written whole or not at all; labels come back as written."""

from pathlib import Path

import pytest

from rwa_monitor.errors import InputError
from rwa_monitor.telemetry.files import atomic_write, read_bytes
from rwa_monitor.telemetry.labels import read_labels, write_labels


def test_writing_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("old")

    def write_half_and_fail() -> None:
        with atomic_write(path) as part:
            part.write_text("half")
            raise KeyError("half way")

    with pytest.raises(KeyError, match="half way"):
        write_half_and_fail()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_is_not_there_is_wrong_use(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written: No such file"), atomic_write(tmp_path / "no" / "file"):
        pass
    with pytest.raises(InputError, match="is a folder"), atomic_write(tmp_path):
        pass


def test_labels_come_back_with_paths_beside_them(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for name in ("a.csv", "in/b, c.csv"):
        (tmp_path / name).touch()
    path = tmp_path / "labels.csv"
    rows = [("a.csv", "0", "0", "1"), ("in/b, c.csv", "1", "0", "0")]
    write_labels([dict(zip(("file", "dry", "viscous", "fss_1"), row, strict=True)) for row in rows], path)
    assert path.read_text() == 'file,dry,viscous,fss_1\na.csv,0,0,1\n"in/b, c.csv",1,0,0\n'
    first, second = read_labels(path)
    assert first.path == tmp_path / "a.csv"
    assert first.anomalies == {"dry": False, "viscous": False, "fss_1": True}
    assert second.path == tmp_path / "in" / "b, c.csv"
    assert second.anomalies == {"dry": True, "viscous": False, "fss_1": False}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "row 1: the header must begin with file,dry,viscous"),
        ("file,viscous,dry\n", "row 1: the header must begin with file,dry,viscous"),
        ("file,dry,viscous\n", "names no file"),
        ("file,dry,viscous,a,a\n", "column 'a': is there twice"),
        ("file,dry,viscous\nhere.csv,0\n", "row 2: has 2 fields, the header has 3"),
        ("file,dry,viscous\nhere.csv,0,yes\n", "row 2, column viscous: 'yes' is neither 0 nor 1"),
        ("file,dry,viscous\n\nnowhere.csv,0,1\n", "row 3, column file: there is no file"),
    ],
)
def test_bad_labels_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "here.csv").touch()
    path = tmp_path / "labels.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_labels(path)


def test_a_small_file_takes_no_memory_for_a_large_limit(tmp_path: Path) -> None:
    path = tmp_path / "small"
    path.write_bytes(b"abc")
    assert read_bytes(path, 2**60) == b"abc"  # more than any machine has
    with pytest.raises(InputError, match="larger than the limit of 2 bytes"):
        read_bytes(path, 2)
    assert read_bytes(path, 3) == b"abc"
