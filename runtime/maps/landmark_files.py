"""Landmarks as a table (CSV) and as GeoJSON, for whoever has neither this program nor ROS."""

import json
import math

import numpy as np

from runtime.messages.map_json import existence
from slam.estimate import LandmarkMap

COLUMNS = "identity,x_m,y_m,var_x_m2,cov_xy_m2,var_y_m2,existence"


def landmark_csv(landmarks: LandmarkMap) -> str:
    """One line for each landmark, in the map frame."""
    lines = [COLUMNS]
    probabilities = existence(landmarks.existence_log_odds)
    for identity, (x, y), p, exists in zip(
        landmarks.identities, landmarks.means_m, landmarks.covariances_m2, probabilities, strict=True
    ):
        lines.append(f"{identity},{x:.4f},{y:.4f},{p[0, 0]:.6g},{p[0, 1]:.6g},{p[1, 1]:.6g},{exists:.4f}")
    return "\n".join(lines) + "\n"


def landmark_geojson(landmarks: LandmarkMap) -> str:
    """A FeatureCollection of points.

    Coordinates are metres of the map frame, not degrees: a map without a geodetic origin has none. The file says so.
    """
    features = []
    probabilities = existence(landmarks.existence_log_odds)
    for identity, mean, p, exists in zip(
        landmarks.identities, landmarks.means_m, landmarks.covariances_m2, probabilities, strict=True
    ):
        larger = math.sqrt(max(float(np.linalg.eigvalsh(p)[-1]), 0.0))
        features.append(
            {
                "type": "Feature",
                "id": int(identity),
                "geometry": {"type": "Point", "coordinates": [round(float(value), 4) for value in mean]},
                "properties": {"sigma_m": round(larger, 4), "existence": round(float(exists), 4)},
            }
        )
    collection = {
        "type": "FeatureCollection",
        "coordinates_are": "metres, x and y of the map frame",
        "features": features,
    }
    return json.dumps(collection, allow_nan=False) + "\n"
