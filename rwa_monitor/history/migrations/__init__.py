"""The history's tables as they changed, for Alembic: a database of an earlier release is brought to the present one."""
