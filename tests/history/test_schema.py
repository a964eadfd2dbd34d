"""The tables on both databases: made anew they are what the migrations give, and old ones keep what they hold."""

from __future__ import annotations

from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Engine, create_engine, text

from rwa_monitor.errors import InputError
from rwa_monitor.history import database
from rwa_monitor.history.database import FIRST, REVISION, bring_up_to_date, migrate
from rwa_monitor.history.store import History
from rwa_monitor.history.tables import Table
from tests.history.support import diagnosis

OF_THE_FIRST = (
    (
        "alarms",
        "spacecraft, wheel, name, phase, level, peak, acknowledged_level, reason, raised_ns, changed_ns",
        "'sat', 'wheel_1', 'viscous', 'active', 2, 2, 0, 'too high', 1, 1",
    ),
    (
        "alarm_states",
        "spacecraft, wheel, name, recent, last_window_ns, alarm_id",
        "'sat', 'wheel_1', 'viscous', '22', 1, 1",
    ),
    ("alarm_events", "alarm_id, kind, level, time_ns, wall_ns, person, note", "1, 'raised', 2, 1, 1, '', ''"),
)


def engine_of(place: Path | str) -> Engine:
    if isinstance(place, Path):
        return create_engine(f"sqlite:///{place}")
    return create_engine(place.replace("postgresql://", "postgresql+psycopg://"))


def differences(engine: Engine) -> list[object]:
    with engine.connect() as connection:
        return list(compare_metadata(MigrationContext.configure(connection), Table.metadata))


def test_the_last_revision_is_the_one_that_the_program_wants() -> None:
    folder = Path(database.__file__).parent / "migrations"
    assert ScriptDirectory(str(folder)).get_current_head() == REVISION


def test_migrated_tables_are_those_that_are_made_anew(place: Path | str) -> None:
    engine = engine_of(place)
    with engine.begin() as connection:
        migrate(connection, REVISION)
    assert differences(engine) == []
    engine.dispose()


def test_tables_made_anew_are_those_of_the_program(place: Path | str) -> None:
    engine = engine_of(place)
    bring_up_to_date(engine)
    bring_up_to_date(engine)
    assert differences(engine) == []
    engine.dispose()


@pytest.mark.parametrize("counted", [True, False], ids=["with revisions", "before revisions were counted"])
def test_a_database_of_an_earlier_release_keeps_what_it_holds(place: Path | str, counted: bool) -> None:
    engine = engine_of(place)
    with engine.begin() as connection:
        migrate(connection, FIRST)
        for table, columns, values in OF_THE_FIRST:
            connection.execute(text(f"INSERT INTO {table} ({columns}) VALUES ({values})"))
        if not counted:
            connection.execute(text("DROP TABLE alembic_version"))
    with History(place) as history:
        (found,) = history.alarms()
        assert (found.reason, found.shelved_until_wall_ns, len(found.trail)) == ("too high", None, 1)
        history.acknowledge(1, "Ann")
        assert history.add(diagnosis(0))
    assert differences(engine) == []
    engine.dispose()


def test_a_database_of_a_later_release_is_refused(place: Path | str) -> None:
    with History(place):
        pass
    engine = engine_of(place)
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    engine.dispose()
    with pytest.raises(InputError, match="later release"):
        History(place)


@pytest.mark.parametrize("url", ["mysql://host/name", "nothing", "postgresql://rwa:secret@127.0.0.1:9/none"])
def test_a_place_that_is_none_is_refused_without_its_password(url: str) -> None:
    with pytest.raises(InputError) as refused:
        History(url)
    assert "secret" not in str(refused.value)
