"""Particles drawn anew from one Gaussian over pose and landmarks, after the pose was found to be elsewhere."""

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.arithmetic.small_matrices import eigen, product, pseudo_inverse
from slam.compiled import kernel
from slam.particles.pages import FIELDS, FREE_PAGES, LOG_ODDS, USED_SLOTS, XX, XY, YY, Pages, X, Y, append
from slam.particles.store import LandmarkStore

SLOTS_PER_LANDMARK = 4  # cells that one landmark lies in, in different particles
PLACE = 3  # of the first landmark behind the pose


def redrawn(
    mean: FloatArray,
    covariance: FloatArray,
    identities: IntArray,
    log_odds: FloatArray,
    normals: FloatArray,
    cell_m: float,
    reach_m: float,
) -> tuple[FloatArray, LandmarkStore]:
    """Poses (M, 3) and maps: each pose with the landmarks (L,) that go with it, as exact as they are given the pose.

    mean (3 + 2 L,) and covariance: pose, then the landmarks. normals (M, 3) to sample with.
    """
    count = len(identities)
    values, vectors = eigen(covariance[:3, :3])
    offsets = product(normals * np.sqrt(np.maximum(values, 0.0)), vectors.T)
    gain = product(covariance[PLACE:, :3], pseudo_inverse(covariance[:3, :3]))
    left = covariance[PLACE:, PLACE:] - product(gain, covariance[:3, PLACE:])
    landmarks = np.zeros((len(normals), count, FIELDS))
    moved = mean[PLACE:] + product(offsets, gain.T)
    landmarks[:, :, X], landmarks[:, :, Y] = moved[:, 0::2], moved[:, 1::2]
    diagonal = np.maximum(np.diag(left), 1e-6)
    landmarks[:, :, XX], landmarks[:, :, YY] = diagonal[0::2], diagonal[1::2]
    bound = 0.99 * np.sqrt(diagonal[0::2] * diagonal[1::2])
    landmarks[:, :, XY] = np.clip(np.diag(left, 1)[0::2], -bound, bound)
    landmarks[:, :, LOG_ODDS] = log_odds
    poses = mean[:3] + offsets
    store = LandmarkStore(len(normals), cell_m, len(normals) * count + 256, SLOTS_PER_LANDMARK * count + 64)
    store.cover(poses, reach_m)
    fill(store.pages, cell_m, landmarks, identities)
    return poses, store


@kernel
def fill(pages: Pages, cell_m: float, landmarks: FloatArray, identities: IntArray) -> None:
    """Give every particle its landmarks (M, L, 6), as far as there is room."""
    for particle in range(landmarks.shape[0]):
        for index in range(identities.size):
            if pages.tally[FREE_PAGES] > 0 and pages.tally[USED_SLOTS] < pages.overflow.size:
                append(pages, particle, cell_m, landmarks[particle, index], identities[index])
