from rwa_monitor.samples import FloatArray, IntArray

def fpop(z: FloatArray, weight: FloatArray, penalty: float) -> IntArray:
    """Return the jumps that minimise Σ weight · (z - level)² + penalty · jumps; z float64 (n,), n ≥ 1."""

def decafs(
    z: FloatArray, correlation: FloatArray, innovation_variance: FloatArray, walk_variance: float, penalty: float
) -> IntArray:
    """Return the jumps of a walking level in autoregressive noise, see `segment_correlated`; n ≥ 1, penalty > 0."""

def segment_sums(running: FloatArray, factors: FloatArray, penalty: float) -> IntArray:
    """Segment a sum of rows, each times its factor, from the rows' running sums alone.

    What a model leaves of the data for ever other coefficients is such a sum: no sample is read again.

    Parameters
    ----------
    running
        float64 (rows, n + 1), running sums of each row from any value on, n ≥ 1.
    factors
        float64 (rows,).
    penalty
        Cost of one jump.
    """

def optimal_curves(sums: FloatArray, keep: FloatArray, penalty: float) -> IntArray:
    """Return the first block of each segment but the first: of a level, or of a level and a multiple of x.

    Parameters
    ----------
    sums
        float64 (6, blocks), sums of 1, x, z, x², xz and z² over each block.
    keep
        float64 (blocks,), factor from the x of a block to that of the next: 1 where x is the same from any start.
    penalty
        Cost of one more level; a multiple of x costs as much again.
    """
