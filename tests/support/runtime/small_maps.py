"""Maps for tests, made without a drive."""

import numpy as np

from runtime.map_files.map_file import MapFacts, encode_map
from runtime.settings.configuration import load_configuration_text
from slam.maps.joint_map import JointMap
from slam.maps.views import BEAMS

FACTS = MapFacts("2026-11-28T12:00:00Z", load_configuration_text("[slam.mount]\nx_m = 0.3\n").text, ("monday",))


def small_map(landmarks: int = 40, inside: int = 12, seed: int = 0) -> JointMap:
    """Posts scattered over 100 m; those beyond the first `inside` hang on the four before them."""
    rng = np.random.default_rng(seed)
    inside = min(inside, landmarks)
    root = rng.normal(0.0, 0.05, (2 * inside, 2 * inside))
    numbers = np.arange(landmarks)[:, None]
    hangs = numbers >= max(inside, 4)
    return JointMap(
        identities=4096 * (1 + np.arange(landmarks)),
        log_odds=np.full(landmarks, 6.0),
        looks=rng.uniform(5.0, 50.0, landmarks),
        finds=rng.uniform(1.0, 5.0, landmarks),
        missed=rng.random(landmarks) < 0.3,
        means_m=rng.uniform(-50.0, 50.0, (landmarks, 2)),
        covariances_m2=np.where(hangs[:, :, None], 0.04 * np.eye(2), 0.0),
        parents=np.where(hangs, numbers - 1 - np.arange(4), -1),
        weights=np.where(hangs[:, :, None], np.tile(0.25 * np.eye(2), 4), 0.0),
        residuals=np.where(hangs[:, :, None], 0.01 * np.eye(2), 0.0),
        block_m2=root @ root.T + 0.01 * np.eye(2 * inside),
        after_miss=np.array((20.0, 8.0)),
        scans=500,
        view_poses=rng.uniform(-3.0, 3.0, (2, 3)),
        view_points_cm=rng.integers(-2000, 2000, (2, BEAMS, 2)).astype(np.int16),
    )


def map_bytes(landmarks: int = 40, facts: MapFacts = FACTS, seed: int = 0) -> bytes:
    return encode_map(small_map(landmarks, seed=seed), facts)
