"""Sums that give the normal equations of a linear model for any set of jumps, the samples being read once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rwa_monitor.kernels.segmentation import centred_sums
from rwa_monitor.samples import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Moments:
    """Sums of columns and data, less their means, in which running sums lose few digits.

    Attributes
    ----------
    products
        float64 (p + 1, p + 1), Σ of the products of all columns and, last, the data.
    running
        float64 (p + 1, n + 1), running sums of the same.
    """

    products: FloatArray
    running: FloatArray

    @classmethod
    def of(cls, design: FloatArray, z: FloatArray) -> Moments:
        """Sum up a design, float64 (n, p), and the data, float64 (n,)."""
        rows = np.concatenate([design.T, z[None, :]])
        running = np.empty((rows.shape[0], z.size + 1))
        if rows.flags.c_contiguous:
            rows -= rows.mean(axis=1, keepdims=True)
            running[:, 0] = 0.0
            np.cumsum(rows, axis=1, out=running[:, 1:])
        else:  # rows that lie beside one another, sample by sample: numpy sums them up ten times more slowly
            centred_sums(rows.T, running)
        return cls(rows @ rows.T, running)

    def within(self, first: IntArray) -> NormalEquations:
        """Return the normal equations with each segment's mean removed; `first` holds the first index of each."""
        edges = np.append(first, self.running.shape[1] - 1)
        sums = np.diff(self.running[:, edges], axis=1)
        inner = self.products - (sums / np.diff(edges)) @ sums.T
        return NormalEquations(inner[:-1, :-1], inner[:-1, -1], float(inner[-1, -1]))


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """Gram matrix, float64 (p, p), moments, float64 (p,), and the sum of squares of the data."""

    gram: FloatArray
    moment: FloatArray
    zz: float

    def rss(self, coefficients: FloatArray) -> float:
        """Return the residual sum of squares with these coefficients, float64 (p,)."""
        left = self.zz - 2 * coefficients @ self.moment + coefficients @ self.gram @ coefficients
        return max(float(left), 0.0)
