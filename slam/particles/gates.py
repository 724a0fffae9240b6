"""What a feature looks like from a pose, and how far it may be from the landmark that it is taken for."""

import math

import numpy as np

from drivers.measurements import FloatArray
from slam.compiled import inlined, kernel, leaf
from slam.observations import Sighting
from slam.particles.proposals import Moments, PoseBelief, linearised_moments, unscented_moments
from slam.settings.tuning import Proposal, Tuning

UNSCENTED = int(Proposal.UNSCENTED)
GATE_BLOCK = 16  # candidates that pass the gate together, a few instructions for all of them


@inlined
def moments_of(belief: PoseBelief, mount: FloatArray, landmark: FloatArray, noise: Sighting, tuning: Tuning) -> Moments:
    """What the proposal in force predicts for one landmark."""
    if tuning.proposal == UNSCENTED:
        return unscented_moments(belief, mount, landmark, noise, tuning.joint_weights, tuning.spread)
    return linearised_moments(belief, mount, landmark, noise)


@inlined
def accepts(distance: float, candidates: FloatArray, chosen: int, tuning: Tuning) -> bool:
    """True if a squared distance is within the bound for this landmark; what the densest place accepts, all do."""
    if tuning.density and distance <= tuning.match_square:
        return True
    return distance <= match_bound(candidates, chosen, tuning)


@leaf
def match_bound(candidates: FloatArray, chosen: int, tuning: Tuning) -> float:
    """M_th = M_c - K d_min (5) with a floor: strict where landmarks are dense, tolerant where one stands alone.

    As a squared Mahalanobis distance; d_min is the distance to the nearest other landmark.
    """
    if not tuning.density:
        return tuning.match_fixed_square
    nearest = math.inf
    for other in range(candidates.shape[0]):
        dx, dy = candidates[other, 0] - candidates[chosen, 0], candidates[other, 1] - candidates[chosen, 1]
        square = dx * dx + dy * dy
        if other != chosen and square < nearest:
            nearest = square
    return min(tuning.match_square + tuning.match_per_metre_square * math.sqrt(nearest), tuning.match_widest_square)


@leaf
def largest_variance(pose_covariance: FloatArray, sighting: Sighting) -> float:
    """Bound m^2 on the variance that pose and sensor cause at the feature's place; the landmark's own comes on top."""
    position: float = pose_covariance[0, 0] + pose_covariance[1, 1]
    heading: float = pose_covariance[2, 2]
    square = sighting.range_m * sighting.range_m
    swing = 2.0 * abs(sighting.range_m) * math.sqrt(heading * position)
    return position + swing + sighting.rr + square * (heading + sighting.bb)


@kernel
def gate_columns(candidates: FloatArray) -> FloatArray:
    """x, y, xx, yy of candidates (C, 6) as rows (4, C up to whole blocks) for `all_outside`."""
    count = candidates.shape[0]
    columns = np.zeros((4, (count + GATE_BLOCK - 1) // GATE_BLOCK * GATE_BLOCK))
    for index in range(count):
        columns[0, index], columns[1, index] = candidates[index, 0], candidates[index, 1]
        columns[2, index], columns[3, index] = candidates[index, 2], candidates[index, 4]
    for index in range(count, columns.shape[1]):
        columns[0, index] = math.inf
    return columns


@inlined
def all_outside(columns: FloatArray, first: int, x: float, y: float, variance: float, bound: float) -> bool:
    """True where no candidate of the block can lie within the bound (a squared distance) of a feature at (x, y)."""
    xs, ys = columns[0, first : first + GATE_BLOCK], columns[1, first : first + GATE_BLOCK]
    xx, yy = columns[2, first : first + GATE_BLOCK], columns[3, first : first + GATE_BLOCK]
    outside = 0
    for place in range(GATE_BLOCK):
        dx, dy = xs[place] - x, ys[place] - y
        outside += 1 if dx * dx + dy * dy > bound * (variance + xx[place] + yy[place]) else 0
    return outside == GATE_BLOCK
