"""Sums of arrays in compiled code: in an order of their own, which is the same on every machine."""

from __future__ import annotations

import numba

from rwa_monitor.samples import FloatArray


@numba.njit(cache=True, error_model="numpy", nogil=True)
def sum_up(values: FloatArray) -> float:
    """Return the sum, as eight side by side: none of its additions waits for the one before it."""
    total, eights = 0.0, values.size - values.size % 8
    if eights > 0:
        a, b, c, d, e, f, g, h = values[:8]
        for i in range(8, eights, 8):
            a, b, c, d = a + values[i], b + values[i + 1], c + values[i + 2], d + values[i + 3]
            e, f, g, h = e + values[i + 4], f + values[i + 5], g + values[i + 6], h + values[i + 7]
        total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for i in range(eights, values.size):
        total += values[i]
    return total
