"""Innovation: what the laser saw of known landmarks minus what it should have seen after the odometry's step."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray
from runtime.review.columns import ReviewColumns
from runtime.review.layout import TRUTH, VERDICTS
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
    places_m = dict(zip(landmarks.identities.tolist(), landmarks.means_m, strict=True))
    known = np.array([k for k, match in enumerate(matches.tolist()) if match in places_m], np.int64)
    if not known.size:
        return np.empty(0), np.empty(0)
    stamps_ns = np.full(2, features.stamp_ns)
    laser_m, ahead_m = predicted.to_map(stamps_ns, np.array(((0.0, 0.0), (1.0, 0.0))), body_from_laser)
    heading_rad = np.arctan2(ahead_m[1] - laser_m[1], ahead_m[0] - laser_m[0])
    offsets_m = np.array([places_m[matches[k]] for k in known.tolist()]) - laser_m
    bearings_rad = np.arctan2(offsets_m[:, 1], offsets_m[:, 0]) - heading_rad
    range_error_m = features.ranges_m[known] - np.hypot(offsets_m[:, 0], offsets_m[:, 1])
    return range_error_m, wrap_rads(features.bearings_rad[known] - bearings_rad)


def draw_innovation(columns: ReviewColumns, range_error_m: FloatArray, bearing_error_rad: FloatArray) -> None:
    """Mean, which shows a bias, and root mean square, which shows noise; nothing where nothing matched."""
    if not range_error_m.size:
        return
    for name, errors in (("range_m", range_error_m), ("bearing_deg", np.degrees(bearing_error_rad))):
        columns.scalar(f"plots/innovation_{name}/mean", float(errors.mean()))
        columns.scalar(f"plots/innovation_{name}/RMS", float(np.sqrt((errors**2).mean())))


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
    stamps_ns = np.full(len(features), features.stamp_ns)
    points_m = motion.to_map(stamps_ns, laser_m, body_from_laser)
    where_m = {} if landmarks is None else dict(zip(landmarks.identities.tolist(), landmarks.means_m, strict=True))
    rover_m = np.array((motion.map_from_body.x_m, motion.map_from_body.y_m))
    spokes_m = [
        np.stack((rover_m, point_m, where_m.get(match, point_m)))
        for point_m, match in zip(points_m, matches.tolist(), strict=True)
        if match >= 0
    ]
    columns.strips("map/association/matched", spokes_m)
    others = [k for k, match in enumerate(matches.tolist()) if match < 0]
    verdicts = [VERDICTS.get(int(matches[k]), (f"verdict {matches[k]}", TRUTH)) for k in others]
    colors = np.array([color for _, color in verdicts], np.uint8).reshape(-1, 3)
    labels = [text for text, _ in verdicts]
    columns.named_points("map/association/new_and_refused", points_m[others], colors, labels)
