from rwa_monitor.samples import FloatArray, IntArray

def filter_gains(
    sign: FloatArray, gap: IntArray, jumps: IntArray, law: tuple[float, float, float, float], gains: FloatArray
) -> float:
    """Compute the gains of the Kalman filter of the noise; return the log-determinant of the covariance without jumps.

    Parameters
    ----------
    sign
        float64 (n,), direction of rotation: the level adds sign · level to the friction.
    gap
        int64 (n,), slots since the previous sample; 0 where a recording begins.
    jumps
        int64 (j,), samples, in order, at which the level has a diffuse prior: their innovations are 0.
    law
        Variances of the white and the AR(1) noise, φ of the AR(1) noise, variance of a recording's level about the
        common one.
    gains
        float64 (n, 4), overwritten: 1 / standard deviation of the innovation, 0 at a jump; gains of the level and of
        the AR(1) noise; φ to the power of the gap.
    """

def whiten(columns: FloatArray, sign: FloatArray, gap: IntArray, gains: FloatArray) -> None:
    """Replace friction and regressors by their innovations over their standard deviations.

    Parameters
    ----------
    columns
        float64 (p, n), friction and regressors with the friction's sign (not along the rotation); overwritten.
    sign, gap, gains
        As for `filter_gains`, with the gains that it wrote.
    """
