"""A second look where noise is coloured: the likelihood of autoregressive noise instead of its largest variance.

The search takes noise as white with the largest variance that any mean of it shows. That is right for slow effects and
right for jumps, but an effect that comes and goes faster than the noise forgets meets much less: there it would be
swallowed. With the noise as an autoregression of order p (Box & Jenkins, Time Series Analysis, 1970), filtering model
and data alike leaves white innovations, and N·log of their variance is the deviance (Cochrane & Orcutt, JASA 44, 1949).
Jumps stay where the search put them: a filter smears them.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy import linalg

from rwa_monitor.discrepancy.base_fit import JUMP_PENALTY, remove_levels, segment_starts, solve_bounded
from rwa_monitor.discrepancy.models import Model
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.samples import BoolArray, FloatArray

ORDER: Final = 4  # lags of the autoregression: a low-pass has two, what it filters another one or two
COLOURED_FROM: Final = 2.0  # long-run over single variance; below, the search's own criterion loses little
REGULAR: Final = 1e-6  # of the variance, added as white noise: a residual without any has no autoregression
ROUNDS: Final = 3  # coefficients and autoregression in turn


def is_coloured(problem: Problem) -> bool:
    """Say whether the noise is coloured, and not by the filter with which friction is derived (no autoregression)."""
    given = not any(record.friction_is_derived for record in problem.records)
    return given and problem.noise.long_run_variance > COLOURED_FROM * problem.noise.std**2


def coloured_gain(problem: Problem, simpler: Model, richer: Model) -> float:
    """Return by how much the penalised criterion falls from one model to the other, noise autoregressive in both."""
    parameters = sum(term.parameters for term in richer.terms) - sum(term.parameters for term in simpler.terms)
    jumps = JUMP_PENALTY * (richer.fit.jumps.size - simpler.fit.jumps.size)
    return _deviance(problem, simpler) - _deviance(problem, richer) - problem.log_size * (parameters + jumps)


def _deviance(problem: Problem, model: Model) -> float:
    """Return N·log of the variance of the innovations, coefficients and autoregression fitted to each other."""
    first = segment_starts(problem, model.fit.jumps)
    design = remove_levels(np.column_stack([problem.speed, *(term.columns for term in model.terms)]), first)
    z = remove_levels(problem.z, first)
    low = np.concatenate([[-np.inf], *(term.low for term in model.terms)])
    high = np.concatenate([[np.inf], *(term.high for term in model.terms)])
    whole = _unbroken(problem, model)
    residual = model.fit.residual
    innovations = residual
    for _ in range(ROUNDS):
        taps = _autoregression(residual)
        filtered, target = _filtered(design, taps)[whole], _filtered(z, taps)[whole]
        coefficients = solve_bounded(problem, filtered.T @ filtered, filtered.T @ target, low, high)
        residual = z - design @ coefficients
        innovations = target - filtered @ coefficients
    floor = REGULAR * problem.noise.std**2
    return problem.size * float(np.log(max(float(np.mean(innovations**2)), floor)))


def _autoregression(residual: FloatArray) -> FloatArray:
    """Return the taps (1, -a₁ … -a_p) of the autoregression with the residual's autocovariance (Yule–Walker)."""
    lags = [float(residual[lag:] @ residual[: residual.size - lag]) for lag in range(ORDER + 1)]
    lags[0] *= 1 + REGULAR
    if lags[0] <= 0:
        return np.concatenate([[1.0], np.zeros(ORDER)])
    solved = np.asarray(linalg.solve_toeplitz(lags[:ORDER], lags[1:]), dtype=np.float64)
    return np.concatenate([[1.0], -solved])


def _filtered(values: FloatArray, taps: FloatArray) -> FloatArray:
    """Apply the taps along the samples; the first ORDER ones are not whole."""
    out = values.copy()
    for lag in range(1, taps.size):
        out[lag:] += taps[lag] * values[:-lag]
    return out


def _unbroken(problem: Problem, model: Model) -> BoolArray:
    """Return which samples have ORDER neighbours before them without gap, change of direction, jump or new record."""
    broken = (np.diff(problem.slot) != 1) | (np.diff(problem.sign) != 0)
    breaks = np.concatenate([[0], np.flatnonzero(broken) + 1, segment_starts(problem, model.fit.jumps)])
    whole = np.ones(problem.size, dtype=bool)
    for lag in range(ORDER):
        whole[np.minimum(breaks + lag, problem.size - 1)] = False
    return whole if whole.any() else np.ones(problem.size, dtype=bool)  # rows of an uneven clock have gaps all over
