"""The database of the history: connection, tables, and the records that the API returns.

SQLite needs no set-up: one file, with a write-ahead log, so that readers and the one writer do not wait for each other.
PostgreSQL, by URL, is for several dashboards and for years of a large fleet. In the tables, names of times on the
wheels' clocks end in `_ns`, on this machine's clock in `_wall_ns`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple, Self
from urllib.parse import quote

import sqlalchemy as sa
from pydantic import BeforeValidator
from sqlalchemy.exc import ArgumentError, SQLAlchemyError
from sqlalchemy.orm import DeclarativeBase, Mapped, Session, mapped_column, relationship

from rwa_monitor.diagnosis.trend import Reach
from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.history.alarms import ALL_WHEELS, BOUNDS, EventKind, Level, advice
from rwa_monitor.messages import AlarmLevel, AlarmPhase, Message, Number, WheelMessage
from rwa_monitor.reporting.diagnoses import EstimateRecord, coefficient_trend
from rwa_monitor.samples import SECONDS_PER_DAY
from rwa_monitor.telemetry.files import make_folder, refusing

POSTGRESQL: Final = "pip install 'rwa-monitor[postgresql]'"
BUSY_TIMEOUT_S: Final = 5.0


class HistoryError(RwaMonitorError):
    """The database cannot be used at present."""


class Database:
    """An open database with the history's tables.

    A file that is removed while it is open would still be written to, and lost when the program ends: no session is
    given while there is another file, or none, at its path.

    Parameters
    ----------
    place
        SQLite file, made where it is missing; or the URL of a PostgreSQL database, which must exist
        (postgresql://USER:PASSWORD@HOST/NAME).

    Raises
    ------
    InputError
        If the file is no database or cannot be opened, the URL is none, or there is no database.
    """

    def __init__(self, place: Path | str) -> None:
        self.path = path = place if isinstance(place, Path) else None
        self._url = _url(place)
        if path is not None:
            make_folder(path.parent)
            with refusing(path, "cannot be used as a history"):
                path.touch()
        self._engine = _open_engine(self._url)
        self._file = _identity(path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Close the database."""
        self._engine.dispose()

    @contextmanager
    def session(self) -> Iterator[Session]:
        """Open a session in a transaction; HistoryError if the database reports an error or its file is gone."""
        if _identity(self.path) != self._file:
            raise HistoryError(self._message("is gone: put it back, or start the dashboard again"))
        try:
            with Session(self._engine) as session, session.begin():
                yield session
        except SQLAlchemyError as error:
            raise HistoryError(self._message(f"cannot be used: {_reason(error)}")) from error

    def _message(self, text: str) -> str:
        return f"the history ({self.path or self._url.render_as_string()}) {text}"


def _identity(path: Path | None) -> tuple[int, int] | None:
    """Return device and inode of the file at a path, None for none."""
    with suppress(OSError):
        return None if path is None else ((facts := path.stat()).st_dev, facts.st_ino)
    return None


def _url(place: Path | str) -> sa.URL:
    """Return the URL of a place; no error shows its password."""
    if isinstance(place, Path):
        # No connection creates the file: a new, empty one would be mistaken for the file that was removed.
        return sa.make_url(f"sqlite:///file:{quote(str(place.absolute()))}?mode=rw&uri=true")
    try:
        url = sa.make_url(place)
    except ArgumentError as error:
        raise InputError("history", "is no URL of a database, such as postgresql://USER:PASSWORD@HOST/NAME") from error
    if url.get_backend_name() != "postgresql":
        raise InputError("history", f"{url.get_backend_name()} is not supported; postgresql is, and a SQLite file")
    return url.set(drivername="postgresql+psycopg")


def _open_engine(url: sa.URL) -> sa.Engine:
    """Open the database and create missing tables."""
    options: dict[str, Any]
    if url.get_backend_name() == "postgresql":
        # A connection that the server has closed in the meantime is replaced by a new one.
        options = {"pool_pre_ping": True, "connect_args": {"connect_timeout": int(BUSY_TIMEOUT_S)}}
    else:
        # The pool ensures that one thread at a time uses a connection.
        options = {"connect_args": {"timeout": BUSY_TIMEOUT_S, "check_same_thread": False}}
    try:
        engine = sa.create_engine(url, **options)
    except ModuleNotFoundError as error:
        raise InputError(url.render_as_string(), f"{error.name} is missing: {POSTGRESQL}") from error
    if engine.dialect.name == "sqlite":
        sa.event.listen(engine, "connect", _set_up_connection)
    try:
        make_tables(engine)
    except (SQLAlchemyError, InputError) as error:
        engine.dispose()
        if isinstance(error, InputError):
            raise
        raise InputError(url.render_as_string(), f"cannot be used as a history: {_reason(error)}") from error
    return engine


def _set_up_connection(connection: Any, record: object) -> None:
    del record
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = FULL")  # a confirmed acknowledgement survives a loss of power
    connection.execute("PRAGMA foreign_keys = ON")


def _reason(error: Exception) -> str:
    return str(getattr(error, "orig", None) or error).splitlines()[0]


def make_tables(engine: sa.Engine) -> None:
    """Create missing tables, in one transaction where the database supports that.

    Raises
    ------
    InputError
        If the database has tables of another revision.
    """
    with engine.begin() as connection:
        Table.metadata.create_all(connection)
        found = connection.scalar(sa.select(RevisionRow.number))
        if found is None:
            connection.execute(sa.insert(RevisionRow).values(number=REVISION))
        elif found != REVISION:
            reason = f"is of another release: its tables are of revision {found}, this program's of {REVISION}"
            raise InputError("history", reason)


# ---- the tables ------------------------------------------------------------------------------------------------------


_Key = Annotated[str, mapped_column(primary_key=True)]
_IntKey = Annotated[int, mapped_column(primary_key=True, autoincrement=False)]
# SQLite numbers rows automatically only in a column of exactly this type.
_RowId = Annotated[int, mapped_column(sa.BigInteger().with_variant(sa.Integer, "sqlite"), primary_key=True)]


REVISION: Final = 2  # of all tables; a change of any table increments it and needs a migration


class Table(DeclarativeBase):
    """Base of all tables."""

    type_annotation_map = {int: sa.BigInteger, str: sa.Text}  # noqa: RUF012 - SQLAlchemy's own way


class _OfWheel:
    """The wheel that a row is of."""

    spacecraft: Mapped[str]
    wheel: Mapped[str]


class _ByWheel:
    """The wheel that a row is of, as the beginning of its key."""

    spacecraft: Mapped[_Key] = mapped_column(sort_order=-1)
    wheel: Mapped[_Key] = mapped_column(sort_order=-1)


class RevisionRow(Table):
    """The revision of the database's tables: one row."""

    __tablename__ = "revision"

    number: Mapped[_IntKey]


class DiagnosisRow(_OfWheel, Table):
    """One diagnosed window; unique. `message` is the diagnosis as on the bus."""

    __tablename__ = "diagnoses"
    __table_args__ = (
        sa.UniqueConstraint("spacecraft", "wheel", "window_start_ns"),
        sa.Index("diagnoses_by_end", "spacecraft", "wheel", "window_end_ns"),
    )

    id: Mapped[_RowId]
    window_start_ns: Mapped[int]
    window_end_ns: Mapped[int]
    message: Mapped[str]


class EstimateRow(_ByWheel, Table):
    """One estimate of one window, kept longer than its diagnosis."""

    __tablename__ = "estimates"

    window_start_ns: Mapped[_IntKey]
    name: Mapped[_Key]
    window_end_ns: Mapped[int]
    value: Mapped[float | None]
    std: Mapped[float | None]
    nominal_low: Mapped[float | None]
    nominal_high: Mapped[float | None]
    unit: Mapped[str]
    probability: Mapped[float]
    severity: Mapped[float | None]
    active: Mapped[bool]


class DiscrepancyRow(_ByWheel, Table):
    """The latest discrepancy report of a wheel, as on the bus."""

    __tablename__ = "discrepancies"

    end_ns: Mapped[int]
    message: Mapped[str]


class WheelEventRow(_OfWheel, Table):
    """One audit event of the list of wheels (a wheel retired or brought back, and by whom); never changed."""

    __tablename__ = "wheel_events"
    __table_args__ = (sa.Index("wheel_events_by_wheel", "spacecraft", "wheel"),)

    id: Mapped[_RowId]
    event: Mapped[str]
    time_ns: Mapped[int | None]  # end of the latest window known then
    wall_ns: Mapped[int]
    person: Mapped[str]  # "" where the wheel's telemetry brought it back
    note: Mapped[str]


class AlarmStateRow(_ByWheel, Table):
    """The state machine of one alarm: its last levels, and the row of the open alarm, if any."""

    __tablename__ = "alarm_states"

    name: Mapped[_Key]
    recent: Mapped[str]  # levels as digits, the oldest first
    last_window_ns: Mapped[int]  # end of the last window processed
    alarm_id: Mapped[int | None] = mapped_column(sa.ForeignKey("alarms.id", ondelete="SET NULL"))
    alarm: Mapped[AlarmRow | None] = relationship()


class AlarmRow(_OfWheel, Table):
    """One alarm from when it is raised until it is closed."""

    __tablename__ = "alarms"
    __table_args__ = (sa.Index("alarms_open", "closed_ns"),)

    id: Mapped[_RowId]
    name: Mapped[str]
    phase: Mapped[AlarmPhase] = mapped_column(sa.Text)
    level: Mapped[int]
    peak: Mapped[int]
    acknowledged_level: Mapped[int]
    reason: Mapped[str]  # of the window that raised or last escalated it
    raised_ns: Mapped[int]
    changed_ns: Mapped[int]
    closed_ns: Mapped[int | None]
    shelved_until_wall_ns: Mapped[int | None]
    trail: Mapped[list[AlarmEventRow]] = relationship(order_by="AlarmEventRow.id")

    @property
    def advice(self) -> str:
        """What to do about it."""
        return advice(ALL_WHEELS if self.wheel == ALL_WHEELS else self.name, Level(self.level))


class AlarmEventRow(Table):
    """One event of an alarm's audit trail; never changed."""

    __tablename__ = "alarm_events"

    id: Mapped[_RowId]
    alarm_id: Mapped[int] = mapped_column(sa.ForeignKey("alarms.id", ondelete="CASCADE"), index=True)
    event: Mapped[str] = mapped_column("kind")
    level: Mapped[int]
    time_ns: Mapped[int]
    wall_ns: Mapped[int]
    person: Mapped[str]  # "" where no person did it
    note: Mapped[str]


# ---- the records of the history that the API returns -----------------------------------------------------------------


# A level as a word, converted from the database's number.
LevelWord = Annotated[AlarmLevel, BeforeValidator(lambda level: Level(level).word if isinstance(level, int) else level)]


class AlarmLine(Message):
    """One line of an alarm's audit trail; `person` is "" where no person did it."""

    event: EventKind
    level: LevelWord
    time_ns: int
    wall_ns: int
    person: str
    note: str


class AlarmRecord(Message):
    """One alarm from its rise to its end; `closed_ns` is null while it is open, `advice` what to do about it.

    Until `shelved_until_wall_ns`, on this machine's clock, it is shelved.
    """

    id: int
    spacecraft: str
    wheel: str
    name: str
    phase: AlarmPhase
    level: LevelWord
    peak: LevelWord
    reason: str
    advice: str
    raised_ns: int
    changed_ns: int
    closed_ns: int | None
    shelved_until_wall_ns: int | None
    trail: list[AlarmLine]


class MonitorState(NamedTuple):
    """Whether the monitor of a wheel reports.

    Attributes
    ----------
    spacecraft, wheel
        The wheel's.
    silent
        Whether it has not reported for too long.
    time_ns
        The latest known time of the wheel [ns, the wheel's clock]; None if none is known.
    reason
        One sentence that says since when; "" if it reports.
    """

    spacecraft: str
    wheel: str
    silent: bool
    time_ns: int | None = None
    reason: str = ""


class RetirementEvent(WheelMessage):
    """One audit event on the list of wheels: retired by a person, brought back by one, or back with its telemetry.

    `time_ns` is the end of the latest window that was known when it was retired, `wall_ns` the time of the event, on
    this machine's clock.
    """

    event: Literal["retired", "brought_back", "telemetry_arrived"]
    time_ns: int | None
    wall_ns: int
    person: str
    note: str

    @property
    def retired(self) -> bool:
        """Whether the wheel is retired after this event."""
        return self.event == "retired"


# ---- trends ----------------------------------------------------------------------------------------------------------


class ReachRecord(Message):
    """When a limit will be reached: median and 95 % interval, in seconds after the last window; null for never."""

    limit: Number
    level: str
    median_s: Number | None
    low_s: Number | None
    high_s: Number | None


class TrendRecord(Message):
    """The trend of one estimate over the windows of a wheel (`diagnosis.trend`)."""

    name: str
    unit: str
    windows: int
    present: bool
    p_value: Number
    slope_per_day: Number
    slope_std_per_day: Number
    reach: ReachRecord | None


def trends(estimates: Sequence[EstimateRecord]) -> list[TrendRecord]:
    """Return the trends of estimates that have a standard deviation, and when they will reach the next alarm level.

    Parameters
    ----------
    estimates
        Of one wheel, the oldest first.
    """
    found = []
    for name in dict.fromkeys(one.name for one in estimates):
        own = [one for one in estimates if one.name == name and one.value is not None and one.std]
        if (coefficient := coefficient_trend(name, own)) is None:
            continue
        trend = coefficient.trend
        limit, level = next((one for one in _limits(own) if one[0] > trend.value), (None, ""))
        reach = None if limit is None else trend.reach(limit)
        found.append(
            TrendRecord(
                name=name,
                unit=coefficient.unit,
                windows=trend.windows,
                present=trend.present,
                p_value=trend.p_value,
                slope_per_day=trend.slope * SECONDS_PER_DAY,
                slope_std_per_day=trend.slope_std * SECONDS_PER_DAY,
                reach=_reach(reach, level, trend.lines.now_s) if reach else None,
            )
        )
    return found


def _reach(reach: Reach, level: str, now_s: float) -> ReachRecord:
    median_s, low_s, high_s = (
        time_s - now_s if math.isfinite(time_s) else None for time_s in (reach.time_s, reach.low_s, reach.high_s)
    )
    return ReachRecord(limit=reach.limit, level=level, median_s=median_s, low_s=low_s, high_s=high_s)


def _limits(own: Sequence[EstimateRecord]) -> list[tuple[float, str]]:
    """Return the values at which an estimate reaches a level, ascending.

    Severity s is at the nominal bound plus s steps; the step is computed from a window with a severity above 0.
    """
    bound = own[-1].nominal_high
    if bound is None:
        return []
    limits = [(bound, "watch")]
    for one in reversed(own):
        if one.severity and one.value is not None and one.nominal_high == bound:
            step = (one.value - bound) / one.severity
            limits += [(bound + severity * step, level.word) for severity, level in BOUNDS]
            break
    return limits
