from rwa_monitor.samples import FloatArray, IntArray

def filter_gains(
    sign: FloatArray, gap: IntArray, jumps: IntArray, law: tuple[float, float, float, float], gains: FloatArray
) -> float:
    """Work out the gains of the Kalman filter of the noise; return the log-determinant of the covariance without jumps.

    Parameters
    ----------
    sign
        float64 (n,), direction of rotation: the level adds sign · level to the friction.
    gap
        int64 (n,), slots since the sample before; 0 where a recording begins.
    jumps
        int64 (j,), samples, in order, that set a level of which nothing is known: their innovations are 0.
    law
        Variances of the white and the coloured noise, φ of the coloured one, variance of a recording's level about the
        common one.
    gains
        float64 (n, 4), overwritten: 1 / standard deviation of the innovation, 0 at a jump; gains of the level and of
        the coloured noise; φ to the power of the gap.
    """

def whiten(columns: FloatArray, sign: FloatArray, gap: IntArray, gains: FloatArray) -> None:
    """Replace friction and regressors by their innovations over their standard deviations.

    Parameters
    ----------
    columns
        float64 (p, n), friction and regressors in the friction's own sign; overwritten.
    sign, gap, gains
        As for `filter_gains`, which made the gains.
    """
