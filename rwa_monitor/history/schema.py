"""Brings a database's tables to the present revision: made anew where there are none, else migrated by Alembic."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from sqlalchemy import Connection, Engine, inspect, text

from rwa_monitor.errors import InputError
from rwa_monitor.history.tables import Table

REVISION: Final = "0004"  # the last one under migrations/versions
FIRST: Final = "0001"
_VERSIONS: Final = "alembic_version"


def bring_up_to_date(engine: Engine) -> None:
    """Make or migrate the tables, in one transaction where the database can do that.

    Raises
    ------
    InputError
        If the database is of a later release than this one.
    """
    with engine.begin() as connection:
        known = set(inspect(connection).get_table_names())
        if not known & set(Table.metadata.tables):
            Table.metadata.create_all(connection)
            _stamp(connection, REVISION)
            return
        if _VERSIONS not in known:  # made before revisions were counted
            _stamp(connection, "0002" if "discrepancies" in known else FIRST)
        found = connection.execute(text(f"SELECT version_num FROM {_VERSIONS}")).scalar_one()  # noqa: S608 - a constant
        if found > REVISION:
            raise InputError("history", f"is of a later release: its revision is {found}, this program's {REVISION}")
        if found != REVISION:
            migrate(connection, REVISION)


def migrate(connection: Connection, revision: str) -> None:
    """Run Alembic's revisions up to one of them."""
    from alembic import command  # noqa: PLC0415 - only where there is something to migrate
    from alembic.config import Config  # noqa: PLC0415

    config = Config()
    config.set_main_option("script_location", str(Path(__file__).parent / "migrations"))
    config.attributes["connection"] = connection
    command.upgrade(config, revision)


def _stamp(connection: Connection, revision: str) -> None:
    connection.execute(text(f"CREATE TABLE IF NOT EXISTS {_VERSIONS} (version_num VARCHAR(32) NOT NULL PRIMARY KEY)"))
    connection.execute(text(f"INSERT INTO {_VERSIONS} VALUES (:revision)"), {"revision": revision})  # noqa: S608
