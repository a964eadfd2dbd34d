"""The strength of an effect in a record: the RMS of the part that base law and levels cannot fit.

Fitted dry levels and slope absorb most of an effect: of `sublinear_viscous` about 5 % remains. A strength in newton
metres therefore means little; here and in all tests it is the RMS of the part orthogonal to sign, speed and levels.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from rwa_monitor.errors import InputError
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect

TAKEN_UP: Final = 1e-6  # share of a column's RMS below which the remainder is rounding


def level_columns(direction: FloatArray, jump_index: IntArray) -> FloatArray:
    """Return s within each segment between jumps and zero outside, float64 (n, jumps + 1)."""
    segment = np.searchsorted(np.asarray(jump_index), np.arange(direction.size), side="right")
    columns = np.zeros((direction.size, len(jump_index) + 1))
    columns[np.arange(direction.size), segment] = direction
    return columns


def orthogonal_part(torque_Nm: FloatArray, channels: Channels, levels: FloatArray) -> FloatArray:
    """Return the residual of a torque after a least-squares fit of speed and levels [N m].

    Parameters
    ----------
    torque_Nm
        float64 (n,) or (n, k).
    channels
        The motion; slots that are not good or not known are left out of the fit.
    levels
        float64 (n, m), see `level_columns`; they add up to the sign, so that it is fitted, too.

    Returns
    -------
    FloatArray
        The shape of `torque_Nm`; zero at the slots left out.
    """
    columns = torque_Nm.reshape(len(channels), -1)
    usable = _usable(columns, channels)
    design = np.column_stack([levels, channels.speed_rad_s])[usable]
    norms = np.linalg.norm(design, axis=0)
    orthonormal, _ = np.linalg.qr(design[:, norms > 0] / norms[norms > 0])
    left = np.zeros_like(columns)
    inside = columns[usable]
    left[usable] = inside - orthonormal @ (orthonormal.T @ inside)
    return left.reshape(torque_Nm.shape)


def orthogonal_rms(torque_Nm: FloatArray, channels: Channels, levels: FloatArray) -> float:
    """Return the RMS of the orthogonal part over the slots that count [N m]."""
    count = int(_usable(torque_Nm.reshape(len(channels), -1), channels).sum())
    left = orthogonal_part(torque_Nm, channels, levels)
    return float(np.sqrt(np.sum(left**2) / max(count, 1)))


def strength_for(
    effect: type[MeanEffect],
    shape: Mapping[str, float],
    channels: Channels,
    levels: FloatArray,
    target_rms_Nm: float,
    rng: np.random.Generator,
) -> dict[str, float]:
    """Draw strengths with which the effect's orthogonal part has a wanted RMS.

    Signs, and the proportions where an effect has several strengths, are random within the physical bounds.

    Parameters
    ----------
    effect, shape
        The effect and the values of its shape parameters.
    channels
        The motion.
    levels
        float64 (n, m), see `level_columns`.
    target_rms_Nm
        Wanted RMS [N m], usually a multiple of the noise's standard deviation.
    rng
        Source of all randomness.

    Returns
    -------
    dict
        A value for each strength parameter; `effect(**shape, **strengths)` is the effect.

    Raises
    ------
    InputError
        If base law and levels fit the effect on this motion, or the wanted RMS needs a strength out of bounds.
    """
    columns, _ = effect.columns(channels, shape)
    parameters = effect.strength_parameters()
    weights = rng.normal(size=len(parameters))
    for j, parameter in enumerate(parameters):
        if parameter.low >= 0.0:
            weights[j] = np.abs(weights[j])
        elif parameter.high <= 0.0:
            weights[j] = -np.abs(weights[j])
    torque = columns @ weights
    rms = orthogonal_rms(torque, channels, levels)
    whole = float(np.sqrt(np.nanmean(torque**2))) if np.isfinite(torque).any() else 0.0
    if rms <= TAKEN_UP * whole:
        raise InputError(f"effect {effect.name}", "does not show on this motion: the base law takes it up")
    strengths = weights * (target_rms_Nm / rms)
    for parameter, value in zip(parameters, strengths, strict=True):
        if not parameter.low <= value <= parameter.high:
            raise InputError(
                f"effect {effect.name}",
                f"an RMS of {target_rms_Nm:g} N m needs {value:g}, outside [{parameter.low}, {parameter.high}]",
                parameter.name,
            )
    return {parameter.name: float(value) for parameter, value in zip(parameters, strengths, strict=True)}


def _usable(columns: FloatArray, channels: Channels) -> BoolArray:
    """Return the slots where columns and speed are known and good, bool (n,)."""
    return channels.good & np.isfinite(channels.speed_rad_s) & np.isfinite(columns).all(axis=1)
