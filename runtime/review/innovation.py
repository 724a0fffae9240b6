"""Innovation: what the laser saw of known landmarks minus what it should have seen after the odometry's step."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import BoolArray, FloatArray
from runtime.review.columns import ReviewColumns
from runtime.review.layout import NAMES, TRUTH, VERDICTS
from runtime.review.ticks import Motion
from slam.estimate import Estimate, LandmarkMap
from slam.observations import Features
from slam.pose import Pose2, wrap_rads


def predicted_motion(before: Estimate, now: Estimate, motion: Motion) -> Motion:
    """The same motion around the pose that odometry alone leads to from the estimate before."""
    step = before.odom_from_body.inverse() @ now.odom_from_body
    return replace(motion, map_from_body=before.map_from_body @ step)


def innovations(
    features: Features, matches: NDArray[np.int64], landmarks: LandmarkMap, predicted: Motion, body_from_laser: Pose2
) -> tuple[FloatArray, FloatArray]:
    """Seen minus expected range in m and bearing in rad, (k,) each, of the features matched to a landmark of the map.

    The map is the last one published (once a second), so that a landmark may be a second older than the filter's.
    """
    places_m, known = places_of(matches, landmarks)
    if not known.any():
        return np.empty(0), np.empty(0)
    laser = predicted.map_from_body_at(features.stamp_ns) @ body_from_laser
    offsets_m = places_m[known] - (laser.x_m, laser.y_m)
    bearings_rad = np.arctan2(offsets_m[:, 1], offsets_m[:, 0]) - laser.heading_rad
    range_error_m = features.ranges_m[known] - np.hypot(offsets_m[:, 0], offsets_m[:, 1])
    return range_error_m, wrap_rads(features.bearings_rad[known] - bearings_rad)


def places_of(identities: NDArray[np.int64], landmarks: LandmarkMap) -> tuple[FloatArray, BoolArray]:
    """Where the landmarks of these identities (n,) are, (n, 2), and which of them the map has, (n,)."""
    if not landmarks.identities.size:
        return np.zeros((identities.size, 2)), np.zeros(identities.size, np.bool_)
    known, means_m = _in_order(landmarks)
    rows = np.minimum(known.searchsorted(identities), known.size - 1)
    return means_m[rows], known[rows] == identities


@lru_cache(maxsize=1)
def _in_order(landmarks: LandmarkMap) -> tuple[NDArray[np.int64], FloatArray]:
    """Identities, ascending, and their means; of the map that is drawn, which stays for a second."""
    order = np.argsort(landmarks.identities)
    return landmarks.identities[order], landmarks.means_m[order]


def draw_innovation(
    columns: ReviewColumns, estimate: Estimate, landmarks: LandmarkMap | None, predicted: Motion, body_from_laser: Pose2
) -> None:
    """Mean, which shows a bias, and root mean square, which shows noise; nothing where nothing matched."""
    if landmarks is None or estimate.features is None or estimate.matches is None:
        return
    range_error_m, bearing_error_rad = innovations(
        estimate.features, estimate.matches, landmarks, predicted, body_from_laser
    )
    if not range_error_m.size:
        return
    for name, errors in (("range_m", range_error_m), ("bearing_deg", np.degrees(bearing_error_rad))):
        columns.scalar(f"plots/innovation_{name}/mean", float(np.add.reduce(errors)) / errors.size)
        columns.scalar(f"plots/innovation_{name}/RMS", math.sqrt(float(errors @ errors) / errors.size))


def draw_association(
    columns: ReviewColumns,
    features: Features,
    matches: NDArray[np.int64],
    motion: Motion,
    body_from_laser: Pose2,
    landmarks: LandmarkMap | None,
) -> None:
    """A spoke from each matched feature to its landmark; a labelled point for each of the others."""
    laser_m = features.ranges_m[:, None] * np.stack(
        (np.cos(features.bearings_rad), np.sin(features.bearings_rad)), axis=-1
    )
    points_m = (motion.map_from_body_at(features.stamp_ns) @ body_from_laser).transform(laser_m)
    matched = matches >= 0
    ends_m = points_m[matched]
    spokes_m = np.empty((len(ends_m), 3, 2))
    spokes_m[:, 0] = motion.map_from_body.x_m, motion.map_from_body.y_m
    spokes_m[:, 1] = spokes_m[:, 2] = ends_m
    if landmarks is not None:
        places_m, known = places_of(matches[matched], landmarks)
        spokes_m[known, 2] = places_m[known]
    columns.strips("map/association/matched", spokes_m)
    others = np.flatnonzero(~matched)
    verdicts = [VERDICTS.get(match, (f"verdict {match}", TRUTH)) for match in matches[others].tolist()]
    colors = np.array([color for _, color in verdicts], np.uint8).reshape(-1, 3)
    labels = [text for text, _ in verdicts]
    columns.named_points("map/association/new_and_refused", points_m[others], colors, labels)
    seen_m = motion.map_from_body.inverse().transform(points_m[others])
    for path, size_m in NAMES.items():
        chosen, words = beside_each_other(seen_m, labels, size_m)
        columns.named_points(path, points_m[others[chosen]], colors[chosen], words)


def beside_each_other(
    points_m: FloatArray, labels: Sequence[str], size_m: tuple[float, float]
) -> tuple[list[int], list[str]]:
    """Numbers of the points that get a label, so that none lies over another of this size, and what each says.

    A point whose label would lie over one of the same words is counted there; others are left to their colour.
    """
    chosen: list[int] = []
    times: list[int] = []
    places = points_m.tolist()
    for number, (x, y) in enumerate(places):
        beside = [
            at
            for at, other in enumerate(chosen)
            if abs(x - places[other][0]) < size_m[0] and abs(y - places[other][1]) < size_m[1]
        ]
        if not beside:
            chosen.append(number)
            times.append(1)
            continue
        for at in beside:
            if labels[chosen[at]] == labels[number]:
                times[at] += 1
                break
    words = [labels[number] + (f" x {count}" if count > 1 else "") for number, count in zip(chosen, times, strict=True)]
    return chosen, words
