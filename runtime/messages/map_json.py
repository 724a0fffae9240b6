"""The map as JSON: on the wire, and beside a run as map.json."""

import json
from typing import Any

import numpy as np

from drivers.measurements import FloatArray
from slam.estimate import LandmarkMap


def landmark_json(landmarks: LandmarkMap, wall_ns: int) -> bytes:
    """The whole map with covariances, as the queryable map answers it."""
    return json_bytes(
        {
            "stamp_ns": wall_ns,
            "frame": "map",
            "identities": landmarks.identities.tolist(),
            "means_m": landmarks.means_m.round(4).tolist(),
            "covariances_m2": landmarks.covariances_m2.tolist(),
            "existence": existence(landmarks.existence_log_odds).round(3).tolist(),
        }
    )


def existence(log_odds: FloatArray) -> FloatArray:
    """Probability that a landmark exists, of its log-odds."""
    probability: FloatArray = 1.0 / (1.0 + np.exp(-log_odds))
    return probability


def json_bytes(value: dict[str, Any]) -> bytes:
    """UTF-8 JSON without NaN, which JSON does not know."""
    return json.dumps(value, allow_nan=False).encode()
