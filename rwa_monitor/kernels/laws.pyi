from typing import Final

from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.switching.duration_likelihoods import Chain, Onset

SOFT_SHARE: Final[float]
LEVEL_NUMBERS: Final[int]

def tabulate(
    at: FloatArray,
    slots: int,
    survivals: FloatArray,
    chain: Chain,
    first: Onset,
    jump: FloatArray,
    stay: FloatArray,
    missed: FloatArray,
) -> None:
    """Fill the tables of one system, which hold -inf on entry.

    Parameters
    ----------
    at, slots
        float64 (m,), the candidates' slots, and the length of the window.
    survivals
        float64 (Q, points), P(τ ≥ slots) of the laws, not softened: at the durations between all pairs of candidates
        (i < j, row by row), at these + 1, from the window's begin to each candidate, and from each candidate to the
        window's end; at the age of the first sojourn: at each candidate, at these + 1, at the window's begin and end.
    chain, first
        The system's laws, and the prior knowledge of its first sojourn.
    jump, stay, missed
        The system's part of `duration_likelihoods.DurationLikelihoods`.
    """

def densities(
    configuration: IntArray, value: FloatArray, std: FloatArray, offset: FloatArray, numbers: FloatArray
) -> FloatArray:
    """Return the learned densities of measured values with an offset added, float64 (3, n, offsets).

    The density under nominal and under anomalous, see `model.log_densities`, and the probability that the value lies in
    no learned band; 1, 1 and NaN where a value is not finite or its configuration was not learned.

    Parameters
    ----------
    configuration, value, std
        (n,), of each value.
    offset
        float64 (offsets,).
    numbers
        float64 (configurations, LEVEL_NUMBERS), see `model.AnomalyModel.numbers`.
    """
