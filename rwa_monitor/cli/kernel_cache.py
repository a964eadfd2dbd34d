"""Sees to it that compiled kernels can be kept for as long as the program runs.

Numba keeps them beside the package, or in the user's cache folder, or where NUMBA_CACHE_DIR says. Where none of these
may be written, as on a read-only root without a home, it refuses to load the functions at all.
"""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from pathlib import Path
from typing import Final

from rwa_monitor.cli.talk import say

VARIABLE: Final = "NUMBA_CACHE_DIR"
PACKAGE: Final = Path(__file__).parents[1]


def provide_kernel_cache() -> None:
    """Let kernels be kept in a folder of this run where no other can be written; to be called before numba is loaded.

    The folder is private and new at each run: what it holds is executed.
    """
    wanted = (os.environ.get(VARIABLE), PACKAGE / "__pycache__", _user_cache())
    if any(folder and _can_be_written(folder) for folder in wanted):
        return
    folder = tempfile.mkdtemp(prefix="rwa-monitor-kernels-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ[VARIABLE] = folder
    say(f"compiled kernels cannot be kept, so each start compiles them: set {VARIABLE} to a folder that can be written")


def _user_cache() -> Path | None:
    """Return where numba keeps kernels of a user, None for one that has no home."""
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "numba"
    except RuntimeError:
        return None


def _can_be_written(folder: str | Path) -> bool:
    """Try it as numba does: what the system says of permissions is not all, for root least."""
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True
