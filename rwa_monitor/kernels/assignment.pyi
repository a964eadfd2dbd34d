from typing import Final

from rwa_monitor.changepoints.running_sums import SumArrays
from rwa_monitor.changepoints.stage_results import SwitchingPath
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.switching.assignment import Scores
from rwa_monitor.switching.friction_model import Cases

REJECT: Final[int]
NO_SYSTEM: Final[int]
STEPS: Final[int]
REJECTED: Final[int]
UNATTRIBUTED: Final[int]
PREFERENCE: Final[float]

def fit_table(pairs: FloatArray, slope: float, variance: float, level_range: float) -> FloatArray:
    """Return the log-likelihood of one level, of a flat prior, between all pairs of nodes: float64 (m + 2, m + 2)."""

def refine_nodes(nodes: IntArray, reach: IntArray, slope: float, variance: float, sums: SumArrays) -> IntArray:
    """See `estimation.refine`; `nodes` are the positions with both ends of the window."""

def find_paths(
    scores: Scores, paths: int, margin: float, budget: int
) -> tuple[FloatArray, IntArray, IntArray, int, bool]:
    """Find the best assignments, distinct: with a narrow beam for a good path, and then the best of all.

    Parameters
    ----------
    scores
        All that they depend on.
    paths
        How many to return at most; the narrow beam is as wide.
    margin
        Paths further below the best than this are of no interest [log-likelihood]; some of these may be returned.
    budget
        Extensions kept per candidate at most.

    Returns
    -------
    score, start, taken, states, pruned
        float64 (paths,), best first; int64 (paths, S) and (paths, m), configurations at the window's begin, and rows of
        the action table at each candidate; entries expanded; whether the budget cut off what may have held a better
        path. Where values are wild, and scores differ by millions, the full search may drop every path within its
        budget; then the path of the narrow beam.
    """

def add_up_laws(scores: Scores, start: IntArray, taken: IntArray, /) -> float: ...
def weigh(
    scores: Scores,
    start: IntArray,
    taken: IntArray,
    index: IntArray,
    pairs: FloatArray,
    slots: int,
    cases: Cases,
    variance: float,
    scatter: float,
) -> tuple[SwitchingPath, IntArray, IntArray, IntArray, FloatArray, float, float]:
    """Weigh a path by its full likelihood.

    Parameters
    ----------
    scores, start, taken, index
        As for `find_paths`; the candidates' slots.
    pairs
        The sufficient statistics between all pairs of nodes, see `estimation.Level`.
    slots
        Length of the window.
    cases
        What is known before it, see `friction_model.prior_tables`.
    variance, scatter
        See `friction_model.solve`.

    Returns
    -------
    path, system, direction, borders, statistics, log_evidence, score
        Who jumped when, see `stage_results.SwitchingPath`; int64 (m, 2), who jumped at each candidate and which way:
        REJECTED or UNATTRIBUTED alone, REJECTED in second place; slots at which the path's segments begin and end, and
        their statistics; the samples' log-likelihood, and the same with the laws'.
    """
