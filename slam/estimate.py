"""What the estimator says after each tick."""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray, IntArray
from slam.arithmetic.elementary import squared
from slam.observations import Features
from slam.pose import Pose2

AHEAD_NS = 1_000_000_000
"""What is stamped later than its tick by more than this was not measured then; a loop wakes up sooner."""

UNKNOWN_M = 1e4  # standard deviation of a position of which nothing is known


class Quality(StrEnum):
    """Whether the pose can be believed."""

    TRACKING = "tracking"
    UNCERTAIN = "uncertain"
    LOST = "lost"


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkMap:
    """Landmarks of the published map, in the map frame.

    identities (L,), means_m (L, 2), covariances_m2 (L, 2, 2), existence_log_odds (L,).
    """

    identities: IntArray
    means_m: FloatArray
    covariances_m2: FloatArray
    existence_log_odds: FloatArray


@dataclass(frozen=True, slots=True)
class Recognition:
    """The rover's place was recognised in a map, or a new map was begun because it was in none.

    map_id: of the map that the pose is in from now on. joined: the map that became part of it, 0 for none. odds: their
    natural logarithm; mirror_odds: the honest figure of what chance reached. by_scans: known by how scans lie on the
    map; matches: landmarks. moved_m, turned_rad: the jump of the pose.
    """

    map_id: int
    is_new: bool = False
    joined: int = 0
    odds: float = 0.0
    mirror_odds: float = 0.0
    probability_wrong: float = 0.0
    by_scans: bool = False
    matches: int = 0
    moved_m: float = 0.0
    turned_rad: float = 0.0

    @property
    def figures(self) -> dict[str, float]:
        """For the record, as counts of the estimate at this scan."""
        names = ("map_id", "is_new", "joined", "odds", "mirror_odds", "by_scans", "matches", "moved_m", "turned_rad")
        figures = {f"recognised_{name}": float(getattr(self, name)) for name in names}
        return {name: value for name, value in figures.items() if math.isfinite(value)}


class KeyframeFit(NamedTuple):
    """A scan laid onto the keyframe of this number: the body (3,) as seen from it, and its information (3, 3)."""

    keyframe: int
    motion: FloatArray
    information: FloatArray


class MapProgress(NamedTuple):
    """map_id, and how many scans and keyframes that map has; unrooted: scans since its rooted part was left."""

    map_id: int
    scans: int
    keyframes: int
    unrooted: int


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The pose at stamp_ns and everything a reviewer wants to know about how it came about.

    map_from_body, covariance (3, 3) over x, y, heading: the published pose.
    particle_mean, particle_covariance: the particles' own, kept beside it; their gap is a health signal.
    quality, doubt: whether the pose can be believed, and why not; the words before the colon name the reason. While it
        is lost the covariance is grown, because the filter's own knows nothing of what happened.
    refusal: why a pose that somebody gave is not believed, at the scan at which that was found; "" else.
    recognition: at the scan at which the rover recognised where it is, or began a new map.
    odom_from_body: dead reckoning alone since the start.
    particles (M, 3) poses and particle_weights (M,): None on a tick without a scan.
    features, matches (K,): features of the scan and what became of each (identity, or a MatchVerdict).
    beam_verdicts (N,) uint8 of BeamVerdict, None without a scan. They and `features` are of the upright scan
        (MountSettings.upright).
    landmarks: filled on every tenth scan (Estimator's map_every), else None.
    counts: figures of this tick by name ("landmarks", "matched", "created", "removed", "likelihoods",
        "effective_particles", ...).
    """

    stamp_ns: int
    map_from_body: Pose2
    covariance: FloatArray
    particle_mean: Pose2
    particle_covariance: FloatArray
    odom_from_body: Pose2
    quality: Quality
    particles: FloatArray | None = None
    particle_weights: FloatArray | None = None
    features: Features | None = None
    matches: IntArray | None = None
    beam_verdicts: NDArray[np.uint8] | None = None
    landmarks: LandmarkMap | None = None
    counts: dict[str, float] = field(default_factory=dict)
    doubt: str = ""
    recognition: Recognition | None = None
    refusal: str = ""


def unknown_pose(stamp_ns: int, doubt: str) -> Estimate:
    """What is said where nothing can be: anywhere within UNKNOWN_M of the origin of the map, and lost."""
    spread = np.diag((squared(UNKNOWN_M), squared(UNKNOWN_M), squared(math.pi)))
    return Estimate(stamp_ns, Pose2(), spread, Pose2(), spread, Pose2(), Quality.LOST, doubt=doubt)
