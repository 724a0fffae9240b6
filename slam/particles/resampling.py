"""Systematic resampling on log weights, and the effective number of particles."""

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.arithmetic.functions import exponentials
from slam.compiled import kernel
from slam.particles.pages import Pages, adopt_row


def normalised(log_weights: FloatArray) -> FloatArray:
    """Weights (M,) that sum to one; equal ones if no log weight is finite, so that a run never ends in NaN."""
    usable = np.where(np.isfinite(log_weights), log_weights, -np.inf)
    peak = usable.max()
    if not np.isfinite(peak):
        return np.full(log_weights.size, 1.0 / log_weights.size)
    weights = exponentials(usable - peak)
    return np.asarray(weights / weights.sum())


def effective_particles(weights: FloatArray) -> float:
    """1 / sum w^2: M for equal weights, 1 when one particle holds everything."""
    return float(1.0 / np.square(weights).sum())


def systematic_copies(weights: FloatArray, offset: float) -> IntArray:
    """How often each particle is kept (M,): one comb of M equally spaced teeth, shifted by offset in [0, 1)."""
    size = weights.size
    edges = np.cumsum(weights) * size
    edges[-1] = size
    # teeth stand at offset + 0 .. M-1; the number of teeth below an edge
    below = np.clip(np.ceil(edges - offset), 0, size).astype(np.int64)
    below[-1] = size
    below = np.maximum.accumulate(below)
    return np.diff(below, prepend=0)


@kernel
def parents_in_place(copies: IntArray) -> IntArray:
    """Who each particle becomes (M,): a survivor stays where it is, the dead take the surplus in order."""
    parents = np.arange(copies.size)
    donor, spare = -1, 0
    for particle in range(copies.size):
        if copies[particle] == 0:
            while spare == 0:
                donor += 1
                spare = max(copies[donor] - 1, 0)
            parents[particle] = donor
            spare -= 1
    return parents


@kernel
def adopt_maps(pages: Pages, parents: IntArray) -> None:
    """Give every particle that has another parent that parent's map. Survivors' maps are only read, so order is
    free.
    """
    for particle in range(parents.size):
        if parents[particle] != particle:
            adopt_row(pages, particle, parents[particle])
