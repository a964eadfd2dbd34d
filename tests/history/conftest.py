"""A history on each database that it is made for: SQLite, and a real PostgreSQL server started for the tests."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp
from typing import Any
from uuid import uuid4

import pytest

from rwa_monitor.history.store import History
from tests.monitor.support import free_port

PATIENCE_S = 60


def programs() -> Path | None:
    """Return where PostgreSQL's programs are: Debian's package keeps them out of the PATH."""
    found = [*Path("/usr/lib/postgresql").glob("*/bin/initdb"), *map(Path, filter(None, [shutil.which("initdb")]))]
    return max(found).parent if found else None


@contextmanager
def server(bin_folder: Path) -> Iterator[str]:
    """Run a separate server on loopback; yields the prefix of its databases' URLs."""
    folder = Path(mkdtemp(prefix="rwa-postgresql-"))
    as_user: dict[str, Any] = {}
    if os.geteuid() == 0:  # PostgreSQL refuses to run as root
        as_user = {"user": "postgres", "group": "postgres", "extra_groups": []}
        shutil.chown(folder, "postgres", "postgres")
    port = free_port()
    data, log = str(folder / "data"), (folder / "log").open("wb")
    run: dict[str, Any] = {"timeout": PATIENCE_S, "cwd": folder, "stdout": log, "stderr": log, **as_user}
    options = f"-c listen_addresses=127.0.0.1 -c unix_socket_directories={folder} -c fsync=off -p {port}"
    try:
        # Independent of the user's locale, which this machine may not have.
        words = ["-D", data, "-U", "rwa", "-A", "trust", "--no-sync", "--locale=C", "--encoding=UTF8"]
        subprocess.run([bin_folder / "initdb", *words], check=True, **run)
        subprocess.run([bin_folder / "pg_ctl", "-D", data, "-o", options, "-w", "start"], check=True, **run)
        try:
            yield f"postgresql://rwa@127.0.0.1:{port}/"
        finally:
            subprocess.run([bin_folder / "pg_ctl", "-D", data, "-m", "immediate", "stop"], check=True, **run)
    finally:
        log.close()
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="session")
def postgresql() -> Iterator[str]:
    found = programs()
    if found is None:
        pytest.skip("no PostgreSQL: apt-get install postgresql")
    with server(found) as address:
        yield address


@pytest.fixture
def new_database(postgresql: str) -> str:
    """Return the URL of a database that is empty."""
    import psycopg

    name = f"test_{uuid4().hex}"
    with psycopg.connect(f"{postgresql}postgres", autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}")
    return f"{postgresql}{name}"


@pytest.fixture(params=["sqlite", "postgresql"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Path | str:
    """Return where a history can be: a SQLite file, and the URL of a PostgreSQL database."""
    return tmp_path / "h.sqlite3" if request.param == "sqlite" else str(request.getfixturevalue("new_database"))


@pytest.fixture
def history(place: Path | str) -> Iterator[History]:
    with History(place) as opened:
        yield opened
