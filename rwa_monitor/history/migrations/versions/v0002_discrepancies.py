"""The latest discrepancy report of each wheel."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "discrepancies",
        sa.Column("spacecraft", sa.Text, primary_key=True),
        sa.Column("wheel", sa.Text, primary_key=True),
        sa.Column("end_ns", sa.BigInteger, nullable=False),
        sa.Column("message", sa.Text, nullable=False),
        sa.Column("stored_wall_ns", sa.BigInteger, nullable=False),
    )


def downgrade() -> None:
    op.drop_table("discrepancies")
