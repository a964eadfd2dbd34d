import numpy as np
from numpy.typing import NDArray

from rwa_monitor.samples import FloatArray, IntArray

NEVER: float

# Level [N m], its variance [N² m²], slots; see `jump_attribution.Segments`.
_Record = tuple[FloatArray, FloatArray, IntArray]
# Counts (systems,); size, its variance, mu, sigma, log up, log down (systems, configurations); base, its variance; see
# `jump_attribution.Chains`.
_Laws = tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, float, float]
# All joint states (states, systems), and the log probability of each at a random moment.
_States = tuple[IntArray, FloatArray]

def likeliest_path(
    record: _Record, laws: _Laws, states: _States, moves: IntArray, beam: int
) -> tuple[IntArray, NDArray[np.uint8], float]:
    """Return the configurations (segments, systems) of the likeliest path, its outliers among them, its log-likelihood.

    `moves`, int64 (moves, systems), are the steps -1, 0 or 1 of each system from a segment to the next; `beam` paths
    are followed. Of paths that are exactly as likely, the first found is kept.
    """
