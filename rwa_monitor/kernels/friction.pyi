from rwa_monitor.changepoints.stage_results import FlatPath
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.switching.friction_model import Cases

def lay_out(path: FlatPath, borders: IntArray, table: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Lay out the linear model of a path; its unknowns are base, sojourns, unattributed jumps, and the slope.

    Parameters
    ----------
    path
        Who jumped when.
    borders
        int64 (segments + 1,), slots at which segments begin and end.
    table
        See `friction_model.law_table`.

    Returns
    -------
    levels
        float64 (segments, unknowns - 1), what each unknown adds to a level; the slope's column left out.
    column
        int64 (all sojourns,), column of each sojourn's friction, -1 where it is 0 by law.
    laws
        float64 (3, free sojourns), of each column that holds a sojourn's friction, which follow the base's: its system,
        mean and standard deviation of its friction law.
    """

def condition(
    levels: FloatArray,
    statistics: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
    block: IntArray,
    variance: float,
    scatter: float,
    posterior_mean: FloatArray,
    posterior: FloatArray,
) -> float:
    """Condition the prior N(mean, covariance) on the segments; return the log evidence.

    Parameters
    ----------
    levels
        As from `lay_out`.
    statistics
        float64 (6, segments), see `SufficientStatistics`.
    mean, covariance
        Of the prior: float64 (unknowns,), (unknowns, unknowns) of which the lower triangle is read and destroyed.
    block
        int64 (unknowns,): the first row of the diagonal block of the covariance that each row belongs to; beyond the
        blocks it is zero. 0 throughout for a full matrix.
    variance, scatter
        See `friction_model.solve`.
    posterior_mean, posterior
        Posterior mean (unknowns,) and covariance (unknowns, unknowns), written.
    """

def solve_cases(
    path: FlatPath,
    borders: IntArray,
    table: FloatArray,
    statistics: FloatArray,
    cases: Cases,
    variance: float,
    scatter: float,
) -> tuple[float, FloatArray, FloatArray, FloatArray, IntArray]:
    """Lay a path out, condition its prior of each case on the segments, and mix what comes out.

    Returns log evidence, mean, standard deviation and covariance of the mixture, and `column` as from `lay_out`.
    """

def evidence_of_cases(
    path: FlatPath,
    borders: IntArray,
    table: FloatArray,
    statistics: FloatArray,
    cases: Cases,
    variance: float,
    scatter: float,
) -> float:
    """Return the log evidence of `solve_cases` alone, in a third of its time."""
