"""The tables on both databases, and places that cannot hold them."""

from __future__ import annotations

from pathlib import Path

import pytest
from sqlalchemy import create_engine, text

from rwa_monitor.errors import InputError
from rwa_monitor.history.store import History


def test_a_database_of_another_release_is_refused(place: Path | str) -> None:
    with History(place):
        pass
    url = f"sqlite:///{place}" if isinstance(place, Path) else place.replace("postgresql://", "postgresql+psycopg://")
    engine = create_engine(url)
    with engine.begin() as connection:
        connection.execute(text("UPDATE revision SET number = 9999"))
    engine.dispose()
    with pytest.raises(InputError, match="another release"):
        History(place)


@pytest.mark.parametrize("url", ["mysql://host/name", "nothing", "postgresql://rwa:secret@127.0.0.1:9/none"])
def test_a_place_that_is_none_is_refused_without_its_password(url: str) -> None:
    with pytest.raises(InputError) as refused:
        History(url)
    assert "secret" not in str(refused.value)
