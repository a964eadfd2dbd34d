"""Sample tables: what is read, to the bit, and what is refused, with file, row, column and reason."""

from decimal import ROUND_HALF_EVEN, Decimal
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rwa_monitor.errors import InputError
from rwa_monitor.samples import TABLE_CHANNELS, FloatArray, Samples
from rwa_monitor.telemetry.files import atomic_write, read_bytes
from rwa_monitor.telemetry.labels import read_labels, write_labels
from rwa_monitor.telemetry.table import file_format, read_table, table_writer, write_parquet

# Each example writes its own file in the one folder, so sharing that folder between examples is harmless.
in_one_folder = settings(
    suppress_health_check=[*settings().suppress_health_check, HealthCheck.function_scoped_fixture], max_examples=150
)

HEAD = "time_s,speed_rad_s,friction_torque_Nm\n"
GOOD = HEAD + "0,100,0.0016\n0.125,101,0.0017\n"


def csv_file(folder: Path, content: str | bytes) -> Path:
    path = folder / "table.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


# ---- what is read ----------------------------------------------------------------------------------------------------


LAYOUTS = {
    "crlf": GOOD.replace("\n", "\r\n"),
    "cr": GOOD.replace("\n", "\r"),
    "no last newline": GOOD.rstrip("\n"),
    "closing blank lines": GOOD + "\n\n",
    "byte order mark": "\ufeff" + GOOD,
    "spaces": GOOD.replace("time_s,", " time_s , ").replace("0.125,", " 0.125 ,\t"),
    "quotes": GOOD.replace("0.125,101", '"0.125","101"'),
    "exponents": GOOD.replace("0.125", "1.25e-1").replace("101", "+1.01E2"),
}


@pytest.mark.parametrize("content", LAYOUTS.values(), ids=LAYOUTS)
def test_layout_of_the_text_does_not_matter(tmp_path: Path, content: str) -> None:
    table = read_table(csv_file(tmp_path, content))
    assert table.samples.time_ns.tolist() == [0, 125_000_000]
    assert table.samples.speed_rad_s.tolist() == [100.0, 101.0]


def test_unknown_columns_and_the_less_exact_of_two_times_are_left_out_and_named(tmp_path: Path) -> None:
    content = "mode,time_s,time_ns,note,speed_rad_s,friction_torque_Nm\nA,5,1,\u00e4,1,2\nB,6,2,,3,4\n"
    table = read_table(csv_file(tmp_path, content))
    assert table.notes == ["columns ignored: mode, time_s, note"]
    assert table.samples.time_ns.tolist() == [1, 2]
    assert table.samples.speed_rad_s.tolist() == [1.0, 3.0]


def test_missing_and_non_finite_values_stay_as_they_are(tmp_path: Path) -> None:
    samples = read_table(csv_file(tmp_path, f"{HEAD}0,,nan\n1,inf,-Infinity\n2,1e999,5\n")).samples
    np.testing.assert_array_equal(samples.speed_rad_s, [np.nan, np.inf, np.inf])
    np.testing.assert_array_equal(samples.friction_torque_Nm, [np.nan, -np.inf, 5])


def test_parquet_takes_any_numbers_and_null(tmp_path: Path) -> None:
    path = tmp_path / "table.parquet"
    columns = {
        "time_s": pa.array([0.0, 0.1, 1_700_000_000.125]),
        "speed_rad_s": pa.array([1, None, 3], pa.int16()),
        "friction_torque_Nm": pa.array([0.5, None, np.inf], pa.float32()),
        "motor_current_A": pa.array([Decimal("1.5"), None, Decimal("2.5")]),
        "bearing_temperature_degC": pa.nulls(3),
        "mode": pa.array(["a", "b", "c"]),
    }
    pq.write_table(pa.table(columns), path)
    table = read_table(path)
    assert table.notes == ["columns ignored: mode"]
    assert table.samples.time_ns.tolist() == [0, 100_000_000, 1_700_000_000_125_000_000]
    np.testing.assert_array_equal(table.samples.speed_rad_s, [1, np.nan, 3])
    np.testing.assert_array_equal(table.samples.friction_torque_Nm, [0.5, np.nan, np.inf])
    np.testing.assert_array_equal(table.samples.motor_current_A, [1.5, np.nan, 2.5])
    np.testing.assert_array_equal(table.samples.bearing_temperature_degC, [np.nan] * 3)


OFFSETS = (
    st.decimals(0, 2_000_000_000, places=9)
    | st.decimals(0, 1000, places=25)
    | st.decimals(0, 10).map(lambda value: value.normalize())
)


@given(st.decimals(-7_000_000_000, 5_000_000_000, places=9), st.sets(OFFSETS, min_size=1, max_size=8))
@in_one_folder
def test_time_is_the_nearest_nanosecond_of_the_decimal_number(
    tmp_path: Path, start: Decimal, offsets: set[Decimal]
) -> None:
    by_nanosecond = {int(((start + x) * 10**9).to_integral_value(ROUND_HALF_EVEN)): start + x for x in offsets}
    expected = sorted(by_nanosecond)
    content = "time_s,speed_rad_s\n" + "".join(f"{by_nanosecond[time_ns]},1\n" for time_ns in expected)
    assert read_table(csv_file(tmp_path, content)).samples.time_ns.tolist() == expected


# ---- round trip ------------------------------------------------------------------------------------------------------


@st.composite
def any_samples(draw: st.DrawFn) -> Samples:
    """Draw any telemetry that a table can hold: increasing times, optional channels, any float64."""
    times = sorted(draw(st.sets(st.integers(-(2**60), 2**60 - 1), min_size=1, max_size=20)))
    values = hnp.arrays(np.float64, len(times), elements=st.floats(width=64))
    optional = {name: draw(st.none() | values) for name in TABLE_CHANNELS[1:]}
    return Samples(time_ns=np.array(times), speed_rad_s=draw(values), **optional)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@given(samples=any_samples())
@in_one_folder
def test_a_written_table_comes_back_bit_for_bit(tmp_path: Path, suffix: str, samples: Samples) -> None:
    path = tmp_path / f"table{suffix}"
    table_writer(path)(samples, path)
    back = read_table(path).samples
    assert [name for name, _ in back.channels()] == [name for name, _ in samples.channels()]
    for (_, read), (_, written) in zip(back.channels(), samples.channels(), strict=True):
        np.testing.assert_array_equal(read, written)
        same_sign = np.signbit(read) == np.signbit(written)
        assert (same_sign | np.isnan(written)).all()


@given(angle=hnp.arrays(np.float64, 5, elements=st.floats(-1e9, 1e9)))
@in_one_folder
def test_an_angle_is_the_same_in_degrees(tmp_path: Path, angle: FloatArray) -> None:
    rows = "".join(f"{at},1,{value!r}\n" for at, value in enumerate(np.degrees(angle).tolist()))
    in_degrees = read_table(csv_file(tmp_path, f"time_s,speed_rad_s,angle_deg\n{rows}"))
    assert in_degrees.notes == []
    np.testing.assert_allclose(in_degrees.samples.angle_rad, angle, rtol=1e-15)
    path = tmp_path / "table.parquet"
    columns = {"time_ns": np.arange(5) * 10**9, "speed_rad_s": np.ones(5), "angle_deg": np.degrees(angle)}
    write_parquet(columns, path)
    np.testing.assert_array_equal(read_table(path).samples.angle_rad, in_degrees.samples.angle_rad)


@given(steps=st.lists(st.integers(95_000_000, 105_000_000), min_size=20, max_size=60))
@in_one_folder
def test_pulse_times_are_the_same_in_seconds_and_nanoseconds(tmp_path: Path, steps: list[int]) -> None:
    times = np.cumsum(steps)
    whole = csv_file(tmp_path, "pulse_time_ns\n" + "".join(f"{time}\n" for time in times))
    expected = read_table(whole, 2).samples
    seconds = csv_file(tmp_path, "pulse_time_s\n" + "".join(f"{Decimal(int(time)).scaleb(-9)}\n" for time in times))
    path = tmp_path / "table.parquet"
    write_parquet({"pulse_time_ns": times}, path)
    for other in (read_table(seconds, 2).samples, read_table(path, 2).samples):
        np.testing.assert_array_equal(other.time_ns, expected.time_ns)
        np.testing.assert_array_equal(other.speed_rad_s, expected.speed_rad_s)
    np.testing.assert_allclose(expected.speed_rad_s, np.pi / 0.1, rtol=0.06)


def test_the_same_samples_give_the_same_bytes_and_no_left_over(tmp_path: Path) -> None:
    samples = read_table(csv_file(tmp_path, GOOD)).samples
    first, second = tmp_path / "first.csv", tmp_path / "second.csv"
    table_writer(first)(samples, first)
    table_writer(second)(samples, second)
    expected = b"time_ns,speed_rad_s,friction_torque_Nm\n0,100,0.0016\n125000000,101,0.0017\n"
    assert first.read_bytes() == second.read_bytes() == expected
    assert sorted(path.name for path in tmp_path.iterdir()) == ["first.csv", "second.csv", "table.csv"]


# ---- what is refused -------------------------------------------------------------------------------------------------

REFUSED = {
    "empty": (b"", "", "is empty"),
    "only newlines": (b"\n\n", "row 1", "no header"),
    "only a header": (HEAD, "", "no rows"),
    "no time": ("speed_rad_s\n1\n", "column time_s or time_ns", "is missing"),
    "two angles": ("time_s,speed_rad_s,angle_rad,angle_deg\n0,1,0,0\n", "column angle_deg", "is there beside angle"),
    "no speed": ("time_s,x\n0,1\n", "column speed_rad_s", "the table has 'time_s', 'x' (docs/formats.md)"),
    "no header": ("0.0,1.5\n0.1,1.5\n", "column time_s or time_ns", "is missing, and so is speed_rad_s"),
    "a date": (HEAD + "2026-01-01T00:00:00Z,1,2\n", "row 2, column time_s", "is not a finite number"),
    "utf-16 without its mark": (GOOD.encode("utf-16-le"), "row 1", "zero bytes"),
    "semicolons": (GOOD.replace(",", ";").encode(), "row 1", "holds ';' and no comma"),
    "a comment": (f"# of a bench\n{GOOD}".encode(), "row 1", "holds '#' and no comma"),
    "twice": ("time_s,speed_rad_s,speed_rad_s\n0,1,1\n", "column speed_rad_s", "twice"),
    "text": (HEAD + "0,1,2\n1,fast,2\n", "row 3, column speed_rad_s", "'fast' is not a number"),
    "underscore": (HEAD + "0,1_0,2\n", "row 2, column speed_rad_s", "'1_0' is not a number"),
    "cut field": (HEAD + "0,1,2\n1,3\n", "row 3", "has 2 fields, the header has 3"),
    "blank line": (HEAD + "0,1,2\n\n1,3,4\n", "row 3, column time_s", "is empty"),
    "infinite time": (HEAD + "0,1,2\ninf,3,4\n", "row 3, column time_s", "'inf' is not a finite number"),
    "a huge exponent": (HEAD + "1e999999999,1,2\n", "row 2, column time_s", "beyond"),
    "equal times": (HEAD + "0,1,2\n0.5,1,2\n0.5,1,2\n", "row 4, column time_s", "(0.5 s after 0.5 s); sort the rows"),
    "rows of one time that contradict": (HEAD + "0,1,2\n0,1,3\n", "row 3, column time_s", "; sort the rows by time"),
    "time goes back": (HEAD + "1,1,2\n-0.25,1,2\n", "row 3, column time_s", "(-0.25 s after 1 s)"),
    "a clock of centuries": (HEAD + "-8e9,1,2\n8e9,1,2\n", "time_s", "73 years"),
    "open quote in the middle": (HEAD + '0,1,"2\n1,1,2"\n2,1,2\n', "row 2", "has no end in its row"),
    "parts of a nanosecond": ("time_ns,speed_rad_s\n0.5,1\n", "row 2, column time_ns", "no whole number"),
    "latin-1": (HEAD.encode() + b"0,1,2\n1,\xe4,2\n", "row 3", "at offset 46)"),
    "utf-16": (GOOD.encode("utf-16"), "row 1", "is no UTF-8 text"),
    "open quote": (HEAD + '0,"1,2\n', "row 2", "is no CSV"),
}


TWICE = ["speed_rad_s"] * 2
PARQUET_REFUSED = {
    "text": ({"time_s": [0.0], "speed_rad_s": ["fast"]}, "column speed_rad_s", "holds string, not numbers"),
    "no rows": ({"time_s": pa.array([], pa.float64()), "speed_rad_s": pa.array([], pa.float64())}, "", "no rows"),
    "null time": ({"time_s": [0.0, None], "speed_rad_s": [1.0, 1.0]}, "row 2, column time_s", "is empty"),
    "infinite": ({"time_s": [0.0, np.inf], "speed_rad_s": [1.0, 1.0]}, "row 2, column time_s", "inf is not a time"),
    "float ns": ({"time_ns": [0.0], "speed_rad_s": [1.0]}, "column time_ns", "holds double, not integers"),
    "unsigned": ({"time_ns": pa.array([2**63], pa.uint64()), "speed_rad_s": [1.0]}, "column time_ns", "beyond"),
    "equal times": ({"time_ns": [1, 1], "speed_rad_s": [1.0, 1.0]}, "row 2, column time_ns", "does not increase"),
    "twice": (pa.table([[0], [1.0], [2.0]], names=["time_ns", *TWICE]), "column speed_rad_s", "is there twice"),
}


@pytest.mark.parametrize(
    ("content", "place", "reason"),
    [*REFUSED.values(), *PARQUET_REFUSED.values()],
    ids=[*REFUSED, *(f"parquet: {name}" for name in PARQUET_REFUSED)],
)
def test_a_bad_table_is_refused_with_place_and_reason(
    tmp_path: Path, content: str | bytes | dict[str, list[object]] | pa.Table, place: str, reason: str
) -> None:
    if isinstance(content, str | bytes):
        path = csv_file(tmp_path, content)
    else:
        path = tmp_path / "table.parquet"
        pq.write_table(content if isinstance(content, pa.Table) else pa.table(content), path)
    with pytest.raises(InputError) as caught:
        read_table(path)
    assert (caught.value.source, caught.value.place) == (str(path), place)
    assert reason in caught.value.reason
    assert "\n" not in str(caught.value)


def test_a_folder_is_refused_with_what_is_in_it(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"is a folder; give the files in it$"):
        read_table(tmp_path)
    (tmp_path / "rwa-000001.mcap").touch()
    with pytest.raises(InputError, match=r"is a folder; give the files in it: .*rwa-000001.mcap"):
        read_table(tmp_path)


@pytest.mark.parametrize("suffix", ["parquet", "mcap"])
def test_a_suffix_of_another_format_is_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"table.{suffix}"
    path.write_text(GOOD)
    with pytest.raises(InputError, match=f"is no {suffix} file"):
        file_format(path)


def test_the_content_decides_where_the_suffix_shows_nothing(tmp_path: Path) -> None:
    written = tmp_path / "table.parquet"
    pq.write_table(pa.table({"time_ns": [1], "speed_rad_s": [2.0]}), written)
    renamed = written.rename(tmp_path / "table.csv")
    assert read_table(renamed).samples.time_ns.tolist() == [1]


# ---- files are read within a limit and written whole or not at all; labels come back as written ----------------------


def test_writing_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("old")
    with pytest.raises(UnicodeEncodeError), atomic_write(path) as part:
        part.write_text("half\udc00", encoding="utf-8")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_is_not_there_is_wrong_use(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written: No such file"), atomic_write(tmp_path / "no" / "file"):
        pass
    with pytest.raises(InputError, match="is a folder"), atomic_write(tmp_path):
        pass


def test_labels_come_back_with_paths_beside_them(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    path, names = tmp_path / "labels.csv", ("file", "dry", "viscous", "fss_1")
    rows = [("a.csv", "0", "0", "1"), ("in/b, c.csv", "1", "0", "0")]
    for name, *_ in rows:
        (tmp_path / name).touch()
    write_labels([dict(zip(names, row, strict=True)) for row in rows], path)
    assert path.read_text() == 'file,dry,viscous,fss_1\na.csv,0,0,1\n"in/b, c.csv",1,0,0\n'
    for found, (name, *flags) in zip(read_labels(path), rows, strict=True):
        assert found.path == tmp_path / name
        assert found.anomalies == {anomaly: flag == "1" for anomaly, flag in zip(names[1:], flags, strict=True)}


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
