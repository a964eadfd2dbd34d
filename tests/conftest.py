"""Settings and fixtures of all tests."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from hypothesis import HealthCheck, settings
from xdist.scheduler import LoadScopeScheduling

import rwa_monitor
from rwa_monitor.monitor.bus import BusOptions, open_session

if Path(rwa_monitor.__file__).resolve().parents[1] != Path(__file__).resolve().parents[1]:  # of another checkout
    raise pytest.UsageError(f"the tests would test {rwa_monitor.__file__}; run make venv in this checkout")

# No deadline per example, since tests are slow on a loaded machine; pytest-timeout ends one that hangs. Examples are
# the same at each run, so that failures are reproducible; --hypothesis-profile=explore tries others.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)
settings.register_profile("explore", settings.get_profile("patient"), derandomize=False)
settings.load_profile("patient")

# Files whose tests share a fixture that takes seconds to make: each file goes to one worker, which makes it once.
SHARING = {
    "test_batch.py",
    "test_c.py",
    "test_cuts.py",
    "test_faults.py",
    "test_fmu.py",
    "test_foxglove.py",
    "test_held_out.py",
    "test_measured.py",
    "test_model_error_shown.py",
    "test_page.py",
    "test_paper_page.py",
    "test_site.py",
    "test_smooth.py",
    "test_wheel_page.py",
}


class BySharing(LoadScopeScheduling):
    """Distributes tests to workers one by one, but those of a file with a shared fixture together.

    The same as `--dist loadgroup`, whose groups xdist 3.8 does not find under pytest 9.
    """

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.partition("::")[0]
        return file if file.rpartition("/")[2] in SHARING else nodeid


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> LoadScopeScheduling:
    return BySharing(config, log)


@pytest.fixture
def session() -> Iterator[zenoh.Session]:
    """An embedded bus."""
    with open_session(BusOptions()) as opened:
        yield opened
