from rwa_monitor.samples import FloatArray, IntArray

def fpop(z: FloatArray, weight: FloatArray, penalty: float) -> IntArray:
    """Return the jumps that minimise Σ weight · (z - level)² + penalty · jumps; z float64 (n,), n ≥ 1."""

def decafs(z: FloatArray, correlation: FloatArray, innovation_variance: FloatArray, penalty: float) -> IntArray:
    """Return the jumps of a level in autoregressive noise, see `segment_correlated`; n ≥ 1, penalty > 0."""

def segment_sums(running: FloatArray, penalty: float) -> IntArray:
    """Segment a sequence from its running sums, float64 (n + 1,), n ≥ 1; `penalty` is the cost of one jump."""

def optimal_curves(sums: FloatArray, keep: FloatArray, penalty: float) -> IntArray:
    """Return the first block of each segment but the first; a segment is a level, or a level and a multiple of x.

    Parameters
    ----------
    sums
        float64 (6, blocks), sums of 1, x, z, x², xz and z² over each block.
    keep
        float64 (blocks,), factor from the x of a block to that of the next: 1 where x is the same from any start.
    penalty
        Cost of one more segment; a multiple of x costs the same in addition.
    """
