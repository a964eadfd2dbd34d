import numpy as np
from numpy.typing import NDArray

from rwa_monitor.samples import IntArray
from rwa_monitor.switching.chain_decoding import Laws, Record, States

NEVER: float

def likeliest_path(
    record: Record, laws: Laws, states: States, moves: IntArray, beam: int
) -> tuple[IntArray, NDArray[np.uint8], float]:
    """Return the configurations (segments, systems) of the likeliest path, its outliers among them, its log-likelihood.

    `moves`, int64 (moves, systems), are the steps -1, 0 or 1 of each system from a segment to the next; `beam` paths
    are followed. Of paths that are exactly as likely, the first found is kept.
    """
