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
    """Move each changepoint to the slot near it that splits its two neighbouring intervals best.

    Parameters
    ----------
    nodes
        int64 (m + 2,), positions, strictly increasing, with both ends of the window.
    reach
        int64 (m,), how far each may move [slots]; never beyond half way to a neighbour, so that no two meet.
    slope, variance
        Shared slope and variance of the noise.
    sums
        Running sums of the window.
    """

def find_paths(
    scores: Scores, paths: int, margin: float, budget: int
) -> tuple[FloatArray, IntArray, IntArray, int, bool]:
    """Find the best distinct assignments: search with a narrow beam for a good path, then for the best of all.

    Parameters
    ----------
    scores
        The tables of the score.
    paths
        Largest number to return; the narrow beam is as wide.
    margin
        Paths further below the best than this may be pruned [log-likelihood], but some of them may be returned.
    budget
        Largest number of extensions kept per candidate.

    Returns
    -------
    score, start, taken, states, pruned
        float64 (paths,), best first; int64 (paths, S) and (paths, m), configurations at the window's begin, and rows of
        the action table at each candidate; entries expanded; whether the budget cut extensions that may have held a
        better path. With extreme values, where scores differ by millions, the budget of the full search may cut every
        path; then the path of the narrow beam is returned.
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
    """Compute the full likelihood of a path.

    Parameters
    ----------
    scores, start, taken, index
        As for `find_paths`; the candidates' slots.
    pairs
        The sufficient statistics between all pairs of nodes, see `estimation.Level`.
    slots
        Length of the window.
    cases
        The prior, see `friction_model.prior_tables`.
    variance, scatter
        See `friction_model.solve`.

    Returns
    -------
    path, system, direction, borders, statistics, log_evidence, score
        See `stage_results.SwitchingPath`; int64 (m, 2), up to two systems that jump at each candidate, and their
        directions: in first place also REJECTED or UNATTRIBUTED, in second place REJECTED if there is none; slots at
        which the path's segments begin and end, and their statistics; the samples' log-likelihood, without and with
        that of the laws.
    """
