"""Diagnoses, estimates, alarms and their audit trail."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

ROW_ID = sa.BigInteger().with_variant(sa.Integer, "sqlite")


def upgrade() -> None:
    """Make the first tables."""
    op.create_table(
        "diagnoses",
        sa.Column("id", ROW_ID, primary_key=True),
        sa.Column("spacecraft", sa.Text, nullable=False),
        sa.Column("wheel", sa.Text, nullable=False),
        sa.Column("window_start_ns", sa.BigInteger, nullable=False),
        sa.Column("window_end_ns", sa.BigInteger, nullable=False),
        sa.Column("verdict", sa.Text, nullable=False),
        sa.Column("message", sa.Text, nullable=False),
        sa.Column("stored_wall_ns", sa.BigInteger, nullable=False),
        sa.UniqueConstraint("spacecraft", "wheel", "window_start_ns"),
    )
    op.create_index("diagnoses_by_end", "diagnoses", ["spacecraft", "wheel", "window_end_ns"])
    op.create_table(
        "estimates",
        sa.Column("spacecraft", sa.Text, primary_key=True),
        sa.Column("wheel", sa.Text, primary_key=True),
        sa.Column("window_start_ns", sa.BigInteger, primary_key=True),
        sa.Column("name", sa.Text, primary_key=True),
        sa.Column("window_end_ns", sa.BigInteger, nullable=False),
        *(sa.Column(name, sa.Double) for name in ("value", "std", "nominal_low", "nominal_high")),
        sa.Column("unit", sa.Text, nullable=False),
        sa.Column("probability", sa.Double, nullable=False),
        sa.Column("severity", sa.Double),
        sa.Column("active", sa.Boolean, nullable=False),
    )
    op.create_table(
        "alarms",
        sa.Column("id", ROW_ID, primary_key=True),
        *(sa.Column(name, sa.Text, nullable=False) for name in ("spacecraft", "wheel", "name", "phase")),
        *(sa.Column(name, sa.BigInteger, nullable=False) for name in ("level", "peak", "acknowledged_level")),
        sa.Column("reason", sa.Text, nullable=False),
        *(sa.Column(name, sa.BigInteger, nullable=False) for name in ("raised_ns", "changed_ns")),
        sa.Column("closed_ns", sa.BigInteger),
    )
    op.create_index("alarms_open", "alarms", ["closed_ns"])
    op.create_table(
        "alarm_states",
        *(sa.Column(name, sa.Text, primary_key=True) for name in ("spacecraft", "wheel", "name")),
        sa.Column("recent", sa.Text, nullable=False),
        sa.Column("last_window_ns", sa.BigInteger, nullable=False),
        sa.Column("alarm_id", ROW_ID, sa.ForeignKey("alarms.id", ondelete="SET NULL")),
    )
    op.create_table(
        "alarm_events",
        sa.Column("id", ROW_ID, primary_key=True),
        sa.Column("alarm_id", ROW_ID, sa.ForeignKey("alarms.id", ondelete="CASCADE"), nullable=False),
        sa.Column("kind", sa.Text, nullable=False),
        *(sa.Column(name, sa.BigInteger, nullable=False) for name in ("level", "time_ns", "wall_ns")),
        *(sa.Column(name, sa.Text, nullable=False) for name in ("person", "note")),
    )
    op.create_index("ix_alarm_events_alarm_id", "alarm_events", ["alarm_id"])


def downgrade() -> None:
    for table in ("alarm_events", "alarm_states", "alarms", "estimates", "diagnoses"):
        op.drop_table(table)
