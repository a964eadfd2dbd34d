from rwa_monitor.samples import FloatArray, IntArray

def whiten(
    columns: FloatArray, sign: FloatArray, drift: FloatArray, gap: IntArray, law: tuple[float, float, float, float]
) -> float:
    """Replace friction and regressors by their innovations over their standard deviations; return Σ log variance.

    Parameters
    ----------
    columns
        float64 (p, n), friction and regressors in the friction's own sign; overwritten.
    sign
        float64 (n,), direction of rotation: the level adds sign · level to the friction.
    drift
        float64 (n,), variance of the level's step before each sample; where a recording begins, of its level about the
        common one. Infinite at a jump: the sample sets the level, its innovation is 0 and is left out of the sum.
    gap
        int64 (n,), slots since the sample before; 0 where a recording begins.
    law
        Variances of the white, the coloured, and, third and fourth, φ of the coloured noise and the variance of the
        noise whose difference enters.
    """
