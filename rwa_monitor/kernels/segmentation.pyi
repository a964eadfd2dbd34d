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

def optimal_lines(sums: FloatArray, penalty: float) -> IntArray:
    """Return the first block of each straight line z(x) but the first.

    `sums`, float64 (6, blocks + 1), are running sums of 1, x, z, x², xz and z²; `penalty` is the cost of one more line.
    """
