"""Until when an alarm is shelved."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    with op.batch_alter_table("alarms") as alarms:
        alarms.add_column(sa.Column("shelved_until_wall_ns", sa.BigInteger))


def downgrade() -> None:
    with op.batch_alter_table("alarms") as alarms:
        alarms.drop_column("shelved_until_wall_ns")
