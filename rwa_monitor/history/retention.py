"""How long the history keeps what, and how finely: by a policy, so that years of a fleet fit into one file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import Delete, delete, func, select
from sqlalchemy.orm import Session

from rwa_monitor.history.tables import AlarmRow, DiagnosisRow, EstimateRow
from rwa_monitor.samples import NANOSECONDS_PER_SECOND

DAY_NS: Final = 86_400 * NANOSECONDS_PER_SECOND


@dataclass(frozen=True, slots=True)
class Retention:
    """How long things are kept, in days before the latest window of the wheel.

    Attributes
    ----------
    diagnoses_days
        Whole diagnoses. What is older is not taken in again either.
    fine_days
        Estimates of every window; older ones are thinned to the worst of each day.
    estimates_days
        Estimates at all.
    alarms_days
        Closed alarms with their audit trail; open ones are kept always.
    """

    diagnoses_days: float = 180.0
    fine_days: float = 365.0
    estimates_days: float = 3650.0
    alarms_days: float = 3650.0

    def __post_init__(self) -> None:
        """Check that estimates last as long as the diagnoses that they are of."""
        if not 0 < self.diagnoses_days <= self.fine_days <= self.estimates_days:
            raise ValueError("diagnoses_days, fine_days and estimates_days must be positive and in this order")


def oldest_ns(end_ns: int, days: float) -> int:
    """Return the time some days before the latest window's end."""
    return end_ns - int(days * DAY_NS)


def prune(session: Session, retention: Retention) -> int:
    """Remove what is older than the policy keeps; returns the number of diagnoses removed."""
    latest = select(EstimateRow.spacecraft, EstimateRow.wheel, func.max(EstimateRow.window_end_ns)).group_by(
        EstimateRow.spacecraft, EstimateRow.wheel
    )
    removed = 0
    for spacecraft, wheel, end_ns in session.execute(latest).all():
        alarms_end = oldest_ns(end_ns, retention.alarms_days)
        removed += _run(session, _older(DiagnosisRow, spacecraft, wheel, oldest_ns(end_ns, retention.diagnoses_days)))
        _run(session, _older(EstimateRow, spacecraft, wheel, oldest_ns(end_ns, retention.estimates_days)))
        _run(session, _thin(spacecraft, wheel, oldest_ns(end_ns, retention.fine_days)))
        _run(
            session,
            delete(AlarmRow).filter_by(spacecraft=spacecraft, wheel=wheel).where(AlarmRow.closed_ns < alarms_end),
        )
    return removed


def _older(table: type[DiagnosisRow | EstimateRow], spacecraft: str, wheel: str, before_ns: int) -> Delete:
    return delete(table).filter_by(spacecraft=spacecraft, wheel=wheel).where(table.window_end_ns < before_ns)


def _thin(spacecraft: str, wheel: str, before_ns: int) -> Delete:
    """Return what removes old estimates but the worst of each part and day; of equals, the latest."""
    own = (EstimateRow.spacecraft == spacecraft) & (EstimateRow.wheel == wheel)
    day = EstimateRow.window_end_ns - EstimateRow.window_end_ns % DAY_NS
    rank = func.row_number().over(
        partition_by=(EstimateRow.name, day),
        order_by=(func.coalesce(EstimateRow.severity, -1.0).desc(), EstimateRow.window_end_ns.desc()),
    )
    old = (
        select(EstimateRow.name, EstimateRow.window_start_ns, rank.label("rank"))
        .where(own, EstimateRow.window_end_ns < before_ns)
        .subquery()
    )
    superfluous = (
        select(old.c.name)
        .where(old.c.rank > 1, old.c.name == EstimateRow.name, old.c.window_start_ns == EstimateRow.window_start_ns)
        .exists()
    )
    return delete(EstimateRow).where(own, superfluous)


def _run(session: Session, statement: Delete) -> int:
    result: Any = session.execute(statement, execution_options={"synchronize_session": False})
    return int(result.rowcount)
