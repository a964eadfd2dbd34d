from typing import Final

from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.switching.duration_likelihoods import Chain, FirstSojourn

SOFT_SHARE: Final[float]
OTHER_SIZE: Final[float]
LEVEL_NUMBERS: Final[int]

def tabulate(
    at: FloatArray,
    slots: int,
    survivals: FloatArray,
    chain: Chain,
    first: FirstSojourn,
    jump: FloatArray,
    stay: FloatArray,
    missed: FloatArray,
) -> None:
    """Fill the tables of one system; they hold -inf.

    Parameters
    ----------
    at, slots
        float64 (m,), the candidates' slots, and the length of the window.
    survivals
        float64 (Q, points), P(τ ≥ slots) of the laws, not softened: at the durations between all pairs of candidates
        (i < j, row by row), at these + 1, from the window's begin to each candidate, and from each to its end.
    chain, first
        The system's laws, and what is known of its first sojourn.
    jump, stay, missed
        The system's part of `duration_likelihoods.DurationLikelihoods`.
    """

def add_up(
    configurations: IntArray, at: FloatArray, slots: int, survivals: FloatArray, chain: Chain, first: FirstSojourn
) -> float:
    """Add up the log-probabilities of a system's sojourns in `configurations`, the later ones begun at the slots `at`.

    Parameters as in `tabulate`, the durations those of the sojourns between its first and last.
    """

def band_densities(value: FloatArray, std: FloatArray, low: float, high: float, soft: float) -> FloatArray:
    """Return the density of measuring each value, with its standard deviation, in a band: float64 (n,)."""

def level_densities(value: FloatArray, std: FloatArray, numbers: FloatArray) -> FloatArray:
    """Return the densities of measured values, float64 (3, n): nominal, anomalous, and both in their learned bands.

    `numbers` as in `model.Levels.numbers`; see `likelihood.log_densities`.
    """

def sojourn_densities(
    configuration: IntArray, friction: FloatArray, std: FloatArray, offset: FloatArray, numbers: FloatArray
) -> FloatArray:
    """Return the densities of a system's sojourns with an offset added, float64 (2, n, offsets); 1 where not known.

    Parameters
    ----------
    configuration, friction, std
        (n,), of each sojourn.
    offset
        float64 (offsets,).
    numbers
        float64 (configurations, LEVEL_NUMBERS), see `model.AnomalyModel.numbers`.
    """

def strays(
    configuration: IntArray, value: FloatArray, std: FloatArray, numbers: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """See `likelihood.stray_probabilities`; `numbers` as in `sojourn_densities`."""
