"""The tables of the history. Times of the wheels' clocks end in `_ns`, times of this machine's in `_wall_ns`."""

from __future__ import annotations

from typing import Final

from sqlalchemy import BigInteger, ForeignKey, Index, Integer, Text, UniqueConstraint
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

# SQLite counts rows by itself only in a column of this very type.
_RowId = BigInteger().with_variant(Integer, "sqlite")


REVISION: Final = 1  # of all tables; a change of one raises it, and brings a migration along


class Table(DeclarativeBase):
    """Base of all tables."""

    type_annotation_map = {int: BigInteger, str: Text}  # noqa: RUF012 - SQLAlchemy's own way


class RevisionRow(Table):
    """The revision of the tables that a database holds: one row."""

    __tablename__ = "revision"

    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)


class DiagnosisRow(Table):
    """One diagnosed window, once. `message` is the diagnosis as it was on the bus."""

    __tablename__ = "diagnoses"
    __table_args__ = (
        UniqueConstraint("spacecraft", "wheel", "window_start_ns"),
        Index("diagnoses_by_end", "spacecraft", "wheel", "window_end_ns"),
    )

    id: Mapped[int] = mapped_column(_RowId, primary_key=True)
    spacecraft: Mapped[str]
    wheel: Mapped[str]
    window_start_ns: Mapped[int]
    window_end_ns: Mapped[int]
    verdict: Mapped[str]
    message: Mapped[str]
    stored_wall_ns: Mapped[int]


class EstimateRow(Table):
    """One estimate of one window, kept longer than the diagnosis it is from."""

    __tablename__ = "estimates"

    spacecraft: Mapped[str] = mapped_column(primary_key=True)
    wheel: Mapped[str] = mapped_column(primary_key=True)
    window_start_ns: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str] = mapped_column(primary_key=True)
    window_end_ns: Mapped[int]
    value: Mapped[float | None]
    std: Mapped[float | None]
    nominal_low: Mapped[float | None]
    nominal_high: Mapped[float | None]
    unit: Mapped[str]
    probability: Mapped[float]
    severity: Mapped[float | None]
    active: Mapped[bool]


class DiscrepancyRow(Table):
    """The latest discrepancy report of a wheel, as it was on the bus."""

    __tablename__ = "discrepancies"

    spacecraft: Mapped[str] = mapped_column(primary_key=True)
    wheel: Mapped[str] = mapped_column(primary_key=True)
    end_ns: Mapped[int]
    message: Mapped[str]
    stored_wall_ns: Mapped[int]


class WheelEventRow(Table):
    """One audit event on the list of wheels: who has retired which wheel; never changed."""

    __tablename__ = "wheel_events"
    __table_args__ = (Index("wheel_events_by_wheel", "spacecraft", "wheel"),)

    id: Mapped[int] = mapped_column(_RowId, primary_key=True)
    spacecraft: Mapped[str]
    wheel: Mapped[str]
    event: Mapped[str]
    time_ns: Mapped[int | None]  # end of the latest window known then
    wall_ns: Mapped[int]
    person: Mapped[str]  # "" where the wheel came back with its telemetry
    note: Mapped[str]


class AlarmStateRow(Table):
    """The state machine of one alarm: its last levels, and the row of its present rise."""

    __tablename__ = "alarm_states"

    spacecraft: Mapped[str] = mapped_column(primary_key=True)
    wheel: Mapped[str] = mapped_column(primary_key=True)
    name: Mapped[str] = mapped_column(primary_key=True)
    recent: Mapped[str]  # levels as digits, the oldest first
    last_window_ns: Mapped[int]  # end of the last window taken in
    alarm_id: Mapped[int | None] = mapped_column(ForeignKey("alarms.id", ondelete="SET NULL"))


class AlarmRow(Table):
    """One alarm from its rise to its end."""

    __tablename__ = "alarms"
    __table_args__ = (Index("alarms_open", "closed_ns"),)

    id: Mapped[int] = mapped_column(_RowId, primary_key=True)
    spacecraft: Mapped[str]
    wheel: Mapped[str]
    name: Mapped[str]
    phase: Mapped[str]
    level: Mapped[int]
    peak: Mapped[int]
    acknowledged_level: Mapped[int]
    reason: Mapped[str]  # of the window that raised it, or made it worse
    raised_ns: Mapped[int]
    changed_ns: Mapped[int]
    closed_ns: Mapped[int | None]
    shelved_until_wall_ns: Mapped[int | None]


class AlarmEventRow(Table):
    """One line of an alarm's audit trail; never changed."""

    __tablename__ = "alarm_events"

    id: Mapped[int] = mapped_column(_RowId, primary_key=True)
    alarm_id: Mapped[int] = mapped_column(ForeignKey("alarms.id", ondelete="CASCADE"), index=True)
    kind: Mapped[str]
    level: Mapped[int]
    time_ns: Mapped[int]
    wall_ns: Mapped[int]
    person: Mapped[str]  # "" where no person did it
    note: Mapped[str]
