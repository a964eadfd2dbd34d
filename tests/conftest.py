"""What holds for all tests."""

from __future__ import annotations

from hypothesis import HealthCheck, settings

# A test on a busy machine takes as long as it takes: pytest-timeout ends one that hangs. The same examples at each run:
# what fails here fails everywhere, and does not pass next time. Others are tried by --hypothesis-profile=explore.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)
settings.register_profile("explore", settings.get_profile("patient"), derandomize=False)
settings.load_profile("patient")
