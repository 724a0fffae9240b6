"""The estimate to bytes and back: the pose and its covariance to the last bit, what a reviewer looks at as float32."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.messages.believed import pose_of, stamp_of
from runtime.messages.tick import Record, decode, encode
from slam.estimate import Estimate, LandmarkMap, Quality
from slam.observations import Features
from slam.pose import Pose2

NO_FLOATS = np.empty(0, np.float32)
NO_INTEGERS = np.empty(0, np.int64)
NO_BYTES = np.empty(0, np.uint8)


def encode_estimate(estimate: Estimate) -> Record:
    """One estimate; a count that is no number is left out."""
    counts = {name: value for name, value in estimate.counts.items() if math.isfinite(value)}
    return encode(
        "/estimate",
        estimate.stamp_ns,
        stamp_ns=estimate.stamp_ns,
        map_from_body=estimate.map_from_body.as_array(),
        covariance=_float64(estimate.covariance),
        particle_mean=estimate.particle_mean.as_array(),
        particle_covariance=_float64(estimate.particle_covariance),
        odom_from_body=estimate.odom_from_body.as_array(),
        quality=estimate.quality.value,
        **_particle_fields(estimate),
        **_feature_fields(estimate.features),
        matches=NO_INTEGERS if estimate.matches is None else estimate.matches.astype(np.int64),
        has_beam_verdicts=estimate.beam_verdicts is not None,
        beam_verdicts=NO_BYTES if estimate.beam_verdicts is None else np.ascontiguousarray(estimate.beam_verdicts),
        **_landmark_fields(estimate.landmarks),
        count_names=list(counts),
        count_values=np.array(list(counts.values()), np.float64),
    )


def decode_estimate(data: bytes, beams: int | None = None) -> Estimate:
    """Back again; arrays that were float32 on disk are float64 of the same value.

    beams: of the scan that was judged, where it is known. Raises ValueError where the verdicts are on others, and
    where a pose, a count or a stamp is none that can be computed with.
    """
    message = decode("/estimate", data)
    if message.has_beam_verdicts and beams not in (None, message.beam_verdicts.size):
        raise ValueError(f"{message.beam_verdicts.size} verdicts on {beams} beams")
    with np.errstate(invalid="ignore"):  # a signalling NaN warns when it is made wider
        return _estimate(message)


def _estimate(message: Any) -> Estimate:
    return Estimate(
        stamp_ns=stamp_of(message.stamp_ns),
        map_from_body=pose_of(message.map_from_body),
        covariance=message.covariance.reshape(3, 3),
        particle_mean=pose_of(message.particle_mean),
        particle_covariance=message.particle_covariance.reshape(3, 3),
        odom_from_body=pose_of(message.odom_from_body),
        quality=Quality(message.quality),
        particles=message.particles.reshape(-1, 3).astype(np.float64) if message.has_particles else None,
        particle_weights=message.particle_weights.astype(np.float64) if message.has_particles else None,
        features=_features(message),
        matches=message.matches if message.has_features else None,
        beam_verdicts=message.beam_verdicts if message.has_beam_verdicts else None,
        landmarks=_landmarks(message),
        counts=_counts(message),
    )


def decode_poses(data: bytes) -> tuple[tuple[Pose2, Pose2, Pose2], dict[str, float]]:
    """Only map_from_body, particle_mean and odom_from_body, for whoever wants the trajectories, and the counts."""
    message = decode("/estimate", data)
    arrays = (message.map_from_body, message.particle_mean, message.odom_from_body)
    published, particles, odometry = map(pose_of, arrays)
    return (published, particles, odometry), _counts(message)


def _counts(message: Any) -> dict[str, float]:
    values = message.count_values.tolist()
    if not all(map(math.isfinite, values)):
        raise ValueError("a count that is not a number")
    return dict(zip(message.count_names, values, strict=True))


def _float64(array: NDArray[Any]) -> NDArray[np.float64]:
    return np.ascontiguousarray(array, np.float64).ravel()


def _float32(array: NDArray[Any]) -> NDArray[np.float32]:
    return np.ascontiguousarray(array, np.float32).ravel()


def _particle_fields(estimate: Estimate) -> dict[str, Any]:
    if estimate.particles is None or estimate.particle_weights is None:
        return {"has_particles": False, "particles": NO_FLOATS, "particle_weights": NO_FLOATS}
    return {
        "has_particles": True,
        "particles": _float32(estimate.particles),
        "particle_weights": _float32(estimate.particle_weights),
    }


def _feature_fields(features: Features | None) -> dict[str, Any]:
    if features is None:
        return {
            "has_features": False,
            "features_stamp_ns": 0,
            "feature_ranges_m": NO_FLOATS,
            "feature_bearings_rad": NO_FLOATS,
            "feature_covariances": NO_FLOATS,
            "feature_may_create": NO_BYTES,
            "feature_identities": NO_INTEGERS,
            "feature_beams": np.empty(0, np.int32),
        }
    return {
        "has_features": True,
        "features_stamp_ns": features.stamp_ns,
        "feature_ranges_m": _float32(features.ranges_m),
        "feature_bearings_rad": _float32(features.bearings_rad),
        "feature_covariances": _float32(features.covariances),
        "feature_may_create": features.may_create.astype(np.uint8),
        "feature_identities": features.identities.astype(np.int64),
        "feature_beams": features.beams.astype(np.int32),
    }


def _features(message: Any) -> Features | None:
    if not message.has_features:
        return None
    return Features(
        stamp_ns=message.features_stamp_ns,
        ranges_m=message.feature_ranges_m.astype(np.float64),
        bearings_rad=message.feature_bearings_rad.astype(np.float64),
        covariances=message.feature_covariances.astype(np.float64).reshape(-1, 2, 2),
        may_create=message.feature_may_create.astype(np.bool_),
        identities=message.feature_identities,
        beams=message.feature_beams.astype(np.int64),
    )


def _landmark_fields(landmarks: LandmarkMap | None) -> dict[str, Any]:
    if landmarks is None:
        return {
            "has_landmarks": False,
            "landmark_identities": NO_INTEGERS,
            "landmark_means_m": np.empty(0),
            "landmark_covariances_m2": NO_FLOATS,
            "landmark_existence_log_odds": NO_FLOATS,
        }
    return {
        "has_landmarks": True,
        "landmark_identities": landmarks.identities.astype(np.int64),
        "landmark_means_m": _float64(landmarks.means_m),
        "landmark_covariances_m2": _float32(landmarks.covariances_m2),
        "landmark_existence_log_odds": _float32(landmarks.existence_log_odds),
    }


def _landmarks(message: Any) -> LandmarkMap | None:
    if not message.has_landmarks:
        return None
    return LandmarkMap(
        identities=message.landmark_identities,
        means_m=message.landmark_means_m.reshape(-1, 2),
        covariances_m2=message.landmark_covariances_m2.astype(np.float64).reshape(-1, 2, 2),
        existence_log_odds=message.landmark_existence_log_odds.astype(np.float64),
    )
