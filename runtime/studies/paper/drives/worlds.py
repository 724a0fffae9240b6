"""Worlds at the level of features: point landmarks, a driven path, and all that disturbs what a sensor reports of them.

P and V2 are the worlds in which the method was tried; LONELY shows one landmark at a time. A drive is a pure function
of kind and seed. World frame: the start pose is not its origin (see runtime.paper.trajectory_error).
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray, Sightings, SpeedYawRate
from runtime.studies.paper.drives.walkers import Walkers, random_walker, walkers_along
from slam.pose import Pose2, wrap_rads

WorldKind = Literal["P", "V2", "LONELY"]

SQUARE_M, CORNER_M, LAPS = 100.0, 15.0, 1.15
SPEED_MPS, PERIOD_NS = 2.0, 200_000_000
PERIOD_S = PERIOD_NS * 1e-9
SPEED_NOISE_MPS, YAW_RATE_NOISE_RADPS = 0.2, math.radians(3.0)
RANGE_NOISE_M, BEARING_NOISE_RAD = 0.1, math.radians(1.0)
VIEW_M, VIEW_RAD, DETECTION = 25.0, math.radians(135.0), 0.9
LANDMARKS, AREA_LOW_M, AREA_HIGH_M = 200, -20.0, 120.0
APART_M, OFF_PATH_M = 2.0, 1.5
SECONDARY_M = 0.5  # a second return this far beside a landmark: its other edge, a branch, a sign


@dataclass(frozen=True, slots=True)
class Disturbances:
    """clutter: false points a scan (mean); secondary: share of sightings with a second return; people: who walks."""

    clutter: float
    secondary: float
    people: Literal["one at random", "twelve along", "nobody"]


DISTURBANCES: dict[WorldKind, Disturbances] = {
    "P": Disturbances(0.1, 0.01, "one at random"),
    "V2": Disturbances(0.3, 0.10, "twelve along"),
    "LONELY": Disturbances(0.0, 0.0, "nobody"),
}


@dataclass(frozen=True, slots=True, eq=False)
class FeatureStep:
    """One scan: what is seen, the wheel samples since the scan before, and what a simulator knows.

    truth: world_from_body. landmark_of_sighting (K,): index of the landmark seen, -1 for clutter, people and second
    returns; the sightings themselves carry no identity.
    """

    stamp_ns: int
    sightings: Sightings
    wheels: tuple[SpeedYawRate, ...]
    truth: Pose2
    landmark_of_sighting: IntArray


@dataclass(frozen=True, eq=False)
class FeatureDrive:
    """One drive: landmarks_m (200, 2) in the world frame, ever_in_view (200,), and the steps in order."""

    kind: WorldKind
    seed: int
    landmarks_m: FloatArray
    ever_in_view: BoolArray
    steps: tuple[FeatureStep, ...]

    @cached_property
    def truth(self) -> FloatArray:
        """(n, 3) world_from_body of every step."""
        return np.array([step.truth.as_array() for step in self.steps])


def feature_world(
    kind: WorldKind, seed: int, scans_at_rest: int = 10, drive: int = 0, exchanged: float = 0.0
) -> FeatureDrive:
    """A drive of 1.15 laps around a rounded square of 100 m at 2 m/s, after standing still for some scans.

    drive: another one is of another day, with other noise and people, and a share of the landmarks exchanged for as
    many elsewhere. Sensor and body frame coincide. Each wheel sample carries the stamp of the scan before and holds
    until the next.
    Raises ValueError for no scan at rest: the first scan defines the frame.
    """
    if scans_at_rest < 1:
        raise ValueError(f"scans_at_rest is {scans_at_rest}, expected 1 or more: the first scan defines the frame")
    generator = np.random.default_rng([seed, list(DISTURBANCES).index(kind)])
    moving = round(LAPS * path_length_m() / (SPEED_MPS * PERIOD_S))
    driven_m = np.concatenate((np.zeros(scans_at_rest), np.arange(1, moving + 1) * SPEED_MPS * PERIOD_S))
    truth = path_poses(driven_m)
    landmarks = lonely_landmarks() if kind == "LONELY" else scattered_landmarks(generator)
    if drive:
        generator = np.random.default_rng([seed, list(DISTURBANCES).index(kind), drive])
        gone = generator.permutation(len(landmarks))[: round(exchanged * len(landmarks))]
        landmarks = np.vstack((np.delete(landmarks, gone, axis=0), scattered_landmarks(generator)[: len(gone)]))
    people = _people(DISTURBANCES[kind], len(truth), generator)
    ever = np.zeros(len(landmarks), dtype=np.bool_)
    steps = []
    for index in range(len(truth)):
        before = truth[max(index - 1, 0)]
        ever[_visible(truth[index], landmarks)] = True
        stamp_ns = index * PERIOD_NS
        sightings, identities = _sight(
            stamp_ns, truth[index], landmarks, people.positions_m[:, index], DISTURBANCES[kind], generator
        )
        wheels = (_wheel_sample(stamp_ns - PERIOD_NS, before, truth[index], generator),)
        pose = Pose2(*(float(value) for value in truth[index]))
        steps.append(FeatureStep(stamp_ns, sightings, wheels, pose, identities))
    return FeatureDrive(kind, seed, landmarks, ever, tuple(steps))


def path_length_m() -> float:
    """One lap of the rounded square."""
    return 4.0 * (SQUARE_M - 2.0 * CORNER_M) + 2.0 * math.pi * CORNER_M


def path_poses(driven_m: FloatArray) -> FloatArray:
    """(n, 3) poses at distances (n,) along the square, counter-clockwise from the start of its lower side."""
    straight, arc = SQUARE_M - 2.0 * CORNER_M, 0.5 * math.pi * CORNER_M
    side, along = np.divmod(driven_m, straight + arc)
    turned = np.maximum(along - straight, 0.0) / CORNER_M
    ahead = np.minimum(along, straight) + CORNER_M * np.sin(turned)
    left = CORNER_M * (1.0 - np.cos(turned))
    quarter = 0.5 * math.pi * np.mod(side, 4.0)
    x, y = CORNER_M + ahead - 0.5 * SQUARE_M, left - 0.5 * SQUARE_M
    centre = 0.5 * SQUARE_M
    return np.column_stack(
        (
            centre + np.cos(quarter) * x - np.sin(quarter) * y,
            centre + np.sin(quarter) * x + np.cos(quarter) * y,
            wrap_rads(quarter + turned),
        )
    )


def scattered_landmarks(generator: np.random.Generator) -> FloatArray:
    """(200, 2) uniform over the area, none too close to another or to the path."""
    path = path_poses(np.arange(0.0, path_length_m(), 0.25))[:, :2]
    kept = np.empty((0, 2))
    while len(kept) < LANDMARKS:
        point = generator.uniform(AREA_LOW_M, AREA_HIGH_M, 2)
        off_path = float(np.hypot(*(path - point).T).min())
        if off_path > OFF_PATH_M and (len(kept) == 0 or float(np.hypot(*(kept - point).T).min()) > APART_M):
            kept = np.vstack((kept, point))
    return kept


def lonely_landmarks() -> FloatArray:
    """(n, 2) landmarks 30 m apart and 15 m outside the path: seldom more than one is in view, at times none."""
    poses = path_poses(np.arange(10.0, path_length_m() - 25.0, 35.0))
    return poses[:, :2] + 15.0 * np.column_stack((np.sin(poses[:, 2]), -np.cos(poses[:, 2])))


def _people(disturbances: Disturbances, steps: int, generator: np.random.Generator) -> Walkers:
    if disturbances.people == "one at random":
        return random_walker(steps, PERIOD_S, AREA_LOW_M, AREA_HIGH_M, generator)
    if disturbances.people == "twelve along":
        return walkers_along(path_poses, 12, 0.7 * SPEED_MPS, steps, PERIOD_S, generator)
    return Walkers(np.empty((0, steps, 2)))


def _visible(pose: FloatArray, points_m: FloatArray) -> IntArray:
    """Indices of points inside range and angle of view."""
    ranges, bearings = _polar(pose, points_m)
    return np.flatnonzero((ranges <= VIEW_M) & (np.abs(bearings) <= VIEW_RAD))


def _polar(pose: FloatArray, points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    dx, dy = points_m[:, 0] - pose[0], points_m[:, 1] - pose[1]
    return np.hypot(dx, dy), wrap_rads(np.arctan2(dy, dx) - pose[2])


def _sight(
    stamp_ns: int,
    pose: FloatArray,
    landmarks_m: FloatArray,
    people_m: FloatArray,
    disturbances: Disturbances,
    generator: np.random.Generator,
) -> tuple[Sightings, IntArray]:
    """Noisy sightings in random order, and the landmark that each one really is."""
    seen = _visible(pose, landmarks_m)
    seen = seen[generator.random(len(seen)) < DETECTION]
    beside = seen[generator.random(len(seen)) < disturbances.secondary]
    side = generator.uniform(-math.pi, math.pi, len(beside))
    seconds = landmarks_m[beside] + SECONDARY_M * np.column_stack((np.cos(side), np.sin(side)))
    walkers = people_m[_visible(pose, people_m)]
    walkers = walkers[generator.random(len(walkers)) < DETECTION]
    points = np.vstack((landmarks_m[seen], seconds, walkers))
    ranges, bearings = _polar(pose, points)
    clutter = int(generator.poisson(disturbances.clutter))
    ranges = np.concatenate((ranges, VIEW_M * np.sqrt(generator.random(clutter))))
    bearings = np.concatenate((bearings, generator.uniform(-VIEW_RAD, VIEW_RAD, clutter)))
    identities = np.full(len(ranges), -1, dtype=np.int64)
    identities[: len(seen)] = seen
    ranges = np.abs(ranges + RANGE_NOISE_M * generator.standard_normal(len(ranges)))
    bearings = wrap_rads(bearings + BEARING_NOISE_RAD * generator.standard_normal(len(ranges)))
    order = generator.permutation(len(ranges))
    unknown = np.full(len(ranges), -1, dtype=np.int64)
    return Sightings(stamp_ns, ranges[order], bearings[order], unknown), identities[order]


def _wheel_sample(stamp_ns: int, before: FloatArray, after: FloatArray, generator: np.random.Generator) -> SpeedYawRate:
    """Speed and yaw rate between two true poses with white noise; exactly zero while nothing moves."""
    turn = math.remainder(float(after[2] - before[2]), 2.0 * math.pi)
    chord = math.hypot(float(after[0] - before[0]), float(after[1] - before[1]))
    if chord == 0.0:
        return SpeedYawRate(stamp_ns, 0.0, 0.0)
    arc = chord * (0.5 * turn / math.sin(0.5 * turn) if abs(turn) > 1e-9 else 1.0)
    noise = generator.standard_normal(2)
    return SpeedYawRate(
        stamp_ns,
        arc / PERIOD_S + SPEED_NOISE_MPS * float(noise[0]),
        turn / PERIOD_S + YAW_RATE_NOISE_RADPS * float(noise[1]),
    )
