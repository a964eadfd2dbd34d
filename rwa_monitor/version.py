"""Which version this is, and how the program names itself in what it writes: messages, recordings, models."""

from __future__ import annotations

from typing import Final

__version__: Final = "0.1.0"
SOFTWARE: Final = f"rwa-monitor {__version__}"
