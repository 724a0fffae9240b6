"""Landmarks as a table (CSV) and as GeoJSON, for whoever has neither this program nor ROS."""

import json
import math

import numpy as np

from runtime.map_files.origin import MapOrigin
from runtime.maps.geodetic import coordinates_note, placed
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


def landmark_geojson(landmarks: LandmarkMap, origin: MapOrigin | None = None) -> str:
    """A FeatureCollection of points.

    Coordinates are degrees where the origin of the map is known, else metres of the map frame. The file says so.
    """
    features = []
    probabilities = existence(landmarks.existence_log_odds)
    points = placed(origin, landmarks.means_m)
    for identity, point, p, exists in zip(
        landmarks.identities, points, landmarks.covariances_m2, probabilities, strict=True
    ):
        larger = math.sqrt(max(float(np.linalg.eigvalsh(p)[-1]), 0.0))
        features.append(
            {
                "type": "Feature",
                "id": int(identity),
                "geometry": {"type": "Point", "coordinates": point},
                "properties": {"sigma_m": round(larger, 4), "existence": round(float(exists), 4)},
            }
        )
    collection = {"type": "FeatureCollection", **coordinates_note(origin), "features": features}
    return json.dumps(collection, allow_nan=False) + "\n"
