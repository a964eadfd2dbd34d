"""What holds for all tests."""

from __future__ import annotations

from hypothesis import settings

# A test on a busy machine takes as long as it takes: pytest-timeout ends one that hangs.
settings.register_profile("patient", deadline=None)
settings.load_profile("patient")
