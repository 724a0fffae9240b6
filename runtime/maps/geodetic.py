"""From metres of a map frame to degrees, by the plane that touches the ellipsoid at the map's origin."""

import math

import numpy as np

from drivers.measurements import FloatArray
from runtime.map_files.origin import MapOrigin
from slam.pose import rotated

EQUATOR_M, FLATTENING = 6_378_137.0, 1.0 / 298.257223563  # WGS 84


def degrees_of(origin: MapOrigin, points_m: FloatArray) -> FloatArray:
    """(n, 2) longitude and latitude, as GeoJSON has them, of points (n, 2) of the map frame.

    East and north are arcs along the parallel and the meridian of the origin: at 1 km from it and 60 degrees north off
    by 0.15 m, and by its square with the distance.
    """
    eccentric = FLATTENING * (2.0 - FLATTENING)
    sine, cosine = math.sin(math.radians(origin.latitude_deg)), math.cos(math.radians(origin.latitude_deg))
    across_m = EQUATOR_M / math.sqrt(1.0 - eccentric * sine**2)
    along_m = across_m * (1.0 - eccentric) / (1.0 - eccentric * sine**2)
    east_north = rotated(points_m, math.radians(origin.heading_deg))
    turns = np.degrees(east_north / np.array((across_m * cosine, along_m)))
    degrees: FloatArray = turns + np.array((origin.longitude_deg, origin.latitude_deg))
    return degrees


def placed(origin: MapOrigin | None, points_m: FloatArray) -> list[list[float]]:
    """Coordinates for GeoJSON: degrees to the centimetre, or metres of the map frame where nobody knows its origin."""
    if origin is None:
        return [[round(value, 4) for value in point] for point in points_m.tolist()]
    return [[round(value, 8) for value in point] for point in degrees_of(origin, points_m).tolist()]


def coordinates_note(origin: MapOrigin | None) -> dict[str, str]:
    """What a GeoJSON file says of its coordinates where they are not the usual ones."""
    return {} if origin is not None else {"coordinates_are": "metres, x and y of the map frame"}
