import numpy as np
import pytest

from drivers.measurements import FloatArray, Scan, uniform_bearings
from runtime.calibrate.scans.shapes import shapes

BEARINGS = uniform_bearings(-np.pi * 0.75, np.radians(0.25), 1081)
STILL = np.zeros(3)


def _scan(ranges: FloatArray, beam_period_s: float = 0.0) -> Scan:
    return Scan(0, ranges.astype(np.float32), BEARINGS, beam_period_s, 0, 30.0)


def _trunk(x: float, y: float, radius: float) -> FloatArray:
    """Exact ranges to a trunk and nothing else."""
    distance, bearing = np.hypot(x, y), np.arctan2(y, x)
    across = distance * np.sin(BEARINGS - bearing)
    hit = (np.abs(across) < radius) & (np.cos(BEARINGS - bearing) > 0.0)
    depth = distance * np.cos(BEARINGS - bearing) - np.sqrt(np.maximum(radius**2 - across**2, 0.0))
    return np.where(hit, depth, np.nan)


def _wall(distance: float, normal: float) -> FloatArray:
    """Exact ranges to an endless wall."""
    cosine = np.cos(BEARINGS - normal)
    return np.where(cosine > 0.3, distance / np.maximum(cosine, 0.1), np.nan)


@pytest.mark.parametrize("bearing", [-2.0, -0.3, 0.0, 1.1])
@pytest.mark.parametrize(("distance", "radius"), [(3.0, 0.1), (5.0, 0.3), (10.0, 0.3)])
def test_the_centre_of_a_trunk_is_found_from_any_side(bearing: float, distance: float, radius: float) -> None:
    x, y = distance * np.cos(bearing), distance * np.sin(bearing)
    found = shapes(_scan(_trunk(x, y, radius)), STILL)
    assert len(found.thing_centres_m) == 1
    # what lies between two beams is not seen
    assert np.hypot(*(found.thing_centres_m[0] - (x, y))) < 0.7 * distance * np.radians(0.25)


def test_a_wall_gives_edges_along_it() -> None:
    found = shapes(_scan(_wall(4.0, 0.5)), STILL)
    assert len(found.edge_lengths_m) >= 3
    np.testing.assert_allclose(np.mod(found.edge_angles_rad - 0.5 + 0.1, np.pi), 0.1, atol=1e-6)
    np.testing.assert_allclose(found.edge_centres_m @ (np.cos(0.5), np.sin(0.5)), 4.0, atol=1e-6)


def test_the_turn_during_a_sweep_is_undone() -> None:
    period, rate = 0.1 / 1440, 0.8
    bearings = BEARINGS + rate * period * np.arange(len(BEARINGS))  # in the frame of the first beam
    cosine = np.cos(bearings - 0.2)
    ranges = np.where(cosine > 0.3, 4.0 / np.maximum(cosine, 0.1), np.nan)
    skewed = shapes(_scan(ranges, period), STILL)
    undone = shapes(_scan(ranges, period), np.array((0.0, 0.0, rate)))
    assert np.ptp(undone.edge_angles_rad) < 1e-6 < np.ptp(skewed.edge_angles_rad)
    np.testing.assert_allclose(undone.edge_centres_m @ (np.cos(0.2), np.sin(0.2)), 4.0, atol=1e-5)


def test_a_thing_at_the_end_of_the_view_is_not_taken_for_whole() -> None:
    bearing = BEARINGS[0]
    assert len(shapes(_scan(_trunk(4.0 * np.cos(bearing), 4.0 * np.sin(bearing), 0.3)), STILL).thing_centres_m) == 0


@pytest.mark.parametrize("ranges", [np.full(1081, np.nan), np.full(1081, np.inf), np.zeros(1081)])
def test_an_empty_scan_has_no_shapes(ranges: FloatArray) -> None:
    found = shapes(_scan(ranges), STILL)
    assert len(found.edge_lengths_m) == 0
    assert len(found.thing_centres_m) == 0


def test_a_scan_without_beams_has_no_shapes() -> None:
    empty = Scan(0, np.zeros(0, dtype=np.float32), np.zeros(0))
    assert len(shapes(empty, STILL).thing_centres_m) == 0
