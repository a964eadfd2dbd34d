import numpy as np
from numpy.typing import NDArray

from rwa_monitor.samples import FloatArray, IntArray

NEVER: float

# Level [N m], its variance [N² m²], slots; see `jump_attribution.Segments`.
_Record = tuple[FloatArray, FloatArray, IntArray]
# Counts (systems,); size, its variance, mu, sigma, log up, log down (systems, configurations); base, its variance; see
# `jump_attribution.Chains`.
_Laws = tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, float, float]
# All joint states (states, systems), and the stationary log probability of each.
_States = tuple[IntArray, FloatArray]

def likeliest_path(
    record: _Record, laws: _Laws, states: _States, moves: IntArray, beam: int
) -> tuple[IntArray, NDArray[np.uint8], float]:
    """Return the most likely path: configurations (segments, systems), outlier segments (segments,), log-likelihood.

    `moves`, int64 (moves, systems), are the steps -1, 0 or 1 of each system from a segment to the next; `beam` is the
    number of paths kept. Of equally likely paths, the first one is kept.
    """
