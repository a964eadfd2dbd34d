"""Small helpers that the mean effects share: how columns are put together and what an unknown channel gives."""

from __future__ import annotations

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels


def stack(*columns: FloatArray) -> FloatArray:
    """Return the columns side by side, float64 (n, number of columns)."""
    return np.stack(columns, axis=1)


def known_or_nan(channel: FloatArray | None, channels: Channels) -> FloatArray:
    """Return an optional channel, or NaN in every slot where it was not measured at all."""
    return np.full(len(channels), np.nan) if channel is None else channel
