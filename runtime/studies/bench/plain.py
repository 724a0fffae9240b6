"""The same work in plain numpy with dense arrays, as a yardstick for the compiled form."""

import time

import numpy as np

from drivers.measurements import FloatArray
from slam.observations import FeatureRows
from slam.particles.fastslam import FastSlam
from slam.pose import wrap_rads

GATE = 9.21  # squared distance, 99 %


def plain_step(particles: FastSlam, features: FeatureRows) -> float:
    """CPU time in ms of associating and updating every feature in every particle, landmarks in dense arrays.

    Maximum likelihood over the whole map and an extended Kalman update of the winner: less than the compiled step
    does (no sampling, no existence), so the ratio flatters numpy.
    """
    landmarks = particles.store.map_of(particles.best)
    count = len(particles.poses)
    means = np.repeat(landmarks.means_m[None], count, axis=0)
    covariances = np.repeat(landmarks.covariances_m2[None], count, axis=0)
    began_ns = time.thread_time_ns()
    noises = np.stack((features.rr, features.rb, features.rb, features.bb), axis=-1).reshape(-1, 2, 2)
    for range_m, bearing_rad, noise in zip(features.ranges_m, features.bearings_rad, noises, strict=True):
        _update(particles.poses, means, covariances, np.array((range_m, bearing_rad)), noise)
    return (time.thread_time_ns() - began_ns) * 1e-6


def _update(poses: FloatArray, means: FloatArray, covariances: FloatArray, z: FloatArray, noise: FloatArray) -> None:
    """One feature: likelihood of every landmark in every particle, then the update of the likeliest."""
    offsets = means - poses[:, None, :2]
    squared = np.einsum("mni,mni->mn", offsets, offsets)
    distance = np.sqrt(squared)
    jacobians = np.empty((*distance.shape, 2, 2))
    jacobians[..., 0, :] = offsets / distance[..., None]
    jacobians[..., 1, 0] = -offsets[..., 1] / squared
    jacobians[..., 1, 1] = offsets[..., 0] / squared
    innovations = np.empty_like(offsets)
    innovations[..., 0] = z[0] - distance
    innovations[..., 1] = wrap_rads(z[1] - (np.arctan2(offsets[..., 1], offsets[..., 0]) - poses[:, None, 2]))
    spreads = np.einsum("mnij,mnjk,mnlk->mnil", jacobians, covariances, jacobians) + noise
    determinants = np.linalg.det(spreads)
    solved = np.linalg.solve(spreads, innovations[..., None])[..., 0]
    squared_distances = np.einsum("mni,mni->mn", innovations, solved)
    best = np.argmax(-0.5 * squared_distances - 0.5 * np.log(determinants), axis=1)
    rows = np.arange(len(poses))
    inside = squared_distances[rows, best] < GATE
    rows, best = rows[inside], best[inside]
    jacobian, covariance, spread = jacobians[rows, best], covariances[rows, best], spreads[rows, best]
    gains = np.einsum("mij,mkj,mkl->mil", covariance, jacobian, np.linalg.inv(spread))
    means[rows, best] += np.einsum("mij,mj->mi", gains, innovations[rows, best])
    covariances[rows, best] -= np.einsum("mij,mjk,mlk->mil", gains, spread, gains)


def plain_resample(particles: int, landmarks: int, rng: np.random.Generator) -> float:
    """CPU time in ms of copying the survivors' maps (x, y, three covariances, log-odds, identity)."""
    maps = rng.standard_normal((particles, landmarks, 7))
    weights = rng.exponential(size=particles)
    times = []
    for _ in range(5):
        began_ns = time.thread_time_ns()
        kept = np.searchsorted(np.cumsum(weights / weights.sum()), (np.arange(particles) + 0.5) / particles)
        maps = maps[np.minimum(kept, particles - 1)]
        times.append((time.thread_time_ns() - began_ns) * 1e-6)
    return float(np.median(times))
