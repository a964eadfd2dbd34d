from rwa_monitor.changepoints.stage_results import SwitchingPath
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.switching.friction_model import Cases

def solve_cases(
    path: SwitchingPath,
    borders: IntArray,
    statistics: FloatArray,
    cases: Cases,
    variance: float,
    scatter: float,
) -> tuple[float, FloatArray, FloatArray, FloatArray, IntArray]:
    """Condition the prior of each case on the segments of a path, and return the mixture of the posteriors.

    Parameters
    ----------
    path
        The sojourns of all systems, and the unattributed jumps.
    borders
        int64 (segments + 1,), slots at which segments begin and end.
    statistics
        float64 (6, segments), see `RunningSums.between`.
    cases
        The prior.
    variance, scatter
        See `friction_model.solve`.

    Returns
    -------
    log_evidence, mean, std, covariance, column
        Of the mixture; the unknowns are base friction, friction of each sojourn where it is not 0 by law, unattributed
        jumps, and the slope. `column`, int64 (all sojourns,), of each sojourn's friction; -1 where it is 0 by law.
    """

def evidence_of_cases(
    path: SwitchingPath,
    borders: IntArray,
    statistics: FloatArray,
    cases: Cases,
    variance: float,
    scatter: float,
) -> float:
    """Return the log evidence of `solve_cases` alone, in a third of its time."""
