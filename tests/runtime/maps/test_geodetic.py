"""Metres of a map frame become degrees where its origin is known."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from drivers.measurements import FloatArray
from runtime.errors import UsageError
from runtime.map_files.end import facts_of
from runtime.map_files.map_file import decode_map, encode_map
from runtime.map_files.origin import MapOrigin, parse_origin
from runtime.maps.geodetic import degrees_of
from runtime.maps.landmark_files import landmark_geojson
from runtime.settings.configuration import load_configuration_text
from tests.support.runtime.small_maps import FACTS, small_map

OSLO = MapOrigin(latitude_deg=59.9139, longitude_deg=10.7522, heading_deg=30.0)


def earth_centred(longitude_deg: float, latitude_deg: float) -> FloatArray:
    """Cartesian coordinates of a point on the ellipsoid, from its axes: another way than the one that is tested."""
    a, b = 6_378_137.0, 6_356_752.314245
    longitude, latitude = math.radians(longitude_deg), math.radians(latitude_deg)
    radius = a**2 / math.sqrt((a * math.cos(latitude)) ** 2 + (b * math.sin(latitude)) ** 2)
    across = radius * math.cos(latitude)
    return np.array(
        (across * math.cos(longitude), across * math.sin(longitude), radius * (b / a) ** 2 * math.sin(latitude))
    )


@pytest.mark.parametrize("latitude_deg", [-70.0, -0.5, 0.0, 34.0, 59.9])
@pytest.mark.parametrize("point", [(300.0, 0.0), (0.0, -300.0), (-200.0, 150.0)])
def test_distances_and_directions_stay(latitude_deg: float, point: tuple[float, float]) -> None:
    origin = MapOrigin(latitude_deg=latitude_deg, longitude_deg=151.0, heading_deg=30.0)
    longitude, latitude = math.radians(origin.longitude_deg), math.radians(latitude_deg)
    east = np.array((-math.sin(longitude), math.cos(longitude), 0.0))
    north = np.array(
        (-math.sin(latitude) * math.cos(longitude), -math.sin(latitude) * math.sin(longitude), math.cos(latitude))
    )
    x, y = np.cos(math.radians(30.0)) * east + np.sin(math.radians(30.0)) * north, 0.0
    y = -np.sin(math.radians(30.0)) * east + np.cos(math.radians(30.0)) * north
    ((there_longitude, there_latitude),) = degrees_of(origin, np.array((point,)))
    gap = earth_centred(there_longitude, there_latitude) - earth_centred(origin.longitude_deg, latitude_deg)
    np.testing.assert_allclose((gap @ x, gap @ y), point, atol=0.03)


def test_a_map_keeps_its_origin_and_an_older_file_has_none() -> None:
    facts = replace(FACTS, origin=parse_origin("59.9139,10.7522,30"))
    saved = decode_map(encode_map(small_map(), facts), "hall.map")
    assert saved.facts.origin == OSLO
    grown = facts_of(load_configuration_text(""), ("tuesday",), saved)
    assert grown.origin == OSLO
    assert decode_map(encode_map(small_map(), FACTS), "old.map").facts.origin is None


def test_geojson_is_in_degrees_where_the_origin_is_known_and_says_so_where_not() -> None:
    landmarks = small_map().landmarks
    with_origin, without = (json.loads(landmark_geojson(landmarks, origin)) for origin in (OSLO, None))
    assert "coordinates_are" not in with_origin
    assert without["coordinates_are"].startswith("metres")
    places = np.array([feature["geometry"]["coordinates"] for feature in with_origin["features"]])
    np.testing.assert_allclose(places, degrees_of(OSLO, landmarks.means_m), atol=1e-8)
    assert np.abs(places - (OSLO.longitude_deg, OSLO.latitude_deg)).max() < 0.01


@pytest.mark.parametrize("text", ["", "59.9", "59.9,10.7,1,2", "north,10", "90,0", "0,181", "nan,0", "1,2,400"])
def test_what_is_no_origin_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="expected LATITUDE,LONGITUDE"):
        parse_origin(text)
