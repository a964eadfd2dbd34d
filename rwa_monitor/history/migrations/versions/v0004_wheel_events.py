"""Who has put which wheel aside."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the table of wheels put aside and come back."""
    op.create_table(
        "wheel_events",
        sa.Column("id", sa.BigInteger().with_variant(sa.Integer, "sqlite"), primary_key=True),
        *(sa.Column(name, sa.Text, nullable=False) for name in ("spacecraft", "wheel", "event")),
        sa.Column("time_ns", sa.BigInteger),
        sa.Column("wall_ns", sa.BigInteger, nullable=False),
        *(sa.Column(name, sa.Text, nullable=False) for name in ("person", "note")),
    )
    op.create_index("wheel_events_by_wheel", "wheel_events", ["spacecraft", "wheel"])


def downgrade() -> None:
    op.drop_table("wheel_events")
