"""What is being looked for, and where: an attempt on one of the maps that the rover knows."""

from dataclasses import dataclass

from slam.joint.gaussian import JointGaussian
from slam.pose import Pose2
from slam.recognise.attempt import LEAST_MATCHES, LEAST_POINTS, LEAST_TOLD, NOTHING, Attempt, Hypothesis
from slam.recognise.local_points import local_points
from slam.recognise.prior import PosePrior
from slam.recognise.scale import Scale
from slam.relocalise.island import Island

MOST_NEAR, MOST_LOOKED_FOR = 14, 28  # landmarks around the rover, the nearest ones, in the first and second attempt
TOLD_SCANS = 50  # of looking around where the rover is said to be, after which nothing will agree any more


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """An attempt on an island, and where the rover was in the source's frame when it began.

    whole: the second of two. is_told: it is restricted to where somebody says that the rover is.
    """

    attempt: Attempt
    source: JointGaussian
    island: Island
    frame_from_body: Pose2
    whole: bool
    is_told: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where the source's frame_from_body stands in a map, beyond reasonable doubt."""

    island: Island
    source: JointGaussian
    frame_from_body: Pose2
    found: Hypothesis


def begin_search(scale: Scale, source: JointGaussian, island: Island, *, whole: bool) -> Search | None:
    """An attempt with what the source has around the rover; None where that is too little, or no other than last.

    The first is made with the nearest points only: the others are the second's new evidence. And where the rover
    comes out of unmapped country, what lies behind it does not speak against the place ahead.
    """
    since = island.rooting.before_scan if source is island.joint else 0
    points = local_points(source.state, scale, since)
    tried = tuple(points.identities.tolist())
    if len(points) < LEAST_MATCHES or not len(island.index) or (not whole and tried == island.tried):
        return None
    island.tried = tried
    near = min(len(points) // 2, MOST_NEAR)
    whole = whole or near < LEAST_POINTS
    attempt = Attempt(scale, island.index.indexed, points.nearest(MOST_LOOKED_FOR if whole else near))
    return Search(attempt, source, island, source.map_from_body, whole)


class ToldPlace:
    """Where somebody says that the rover is in a map, and what looking for it has come to.

    prior: at the last scan. With it one attempt is enough: what was said is the other evidence.
    """

    def __init__(self, prior: PosePrior) -> None:
        self.prior = prior
        self.best = NOTHING
        self._scans = 0
        self._tried: tuple[int, ...] = ()

    def follow(self, increment: Pose2) -> None:
        """The rover has moved and looked around."""
        self.prior = self.prior.moved(increment)
        self._scans += 1

    def begin(self, scale: Scale, source: JointGaussian, island: Island) -> Search | None:
        """The next attempt; None where the source has nothing new around the rover."""
        points = local_points(source.state, scale)
        tried = tuple(points.identities.tolist())
        if len(points) < LEAST_TOLD or not len(island.index) or tried == self._tried:
            return None
        self._tried = tried
        attempt = Attempt(scale, island.index.indexed, points.nearest(MOST_LOOKED_FOR), self.prior)
        return Search(attempt, source, island, source.map_from_body, whole=True, is_told=True)

    def add(self, found: Hypothesis) -> bool:
        """Whether this is the place."""
        if found.odds > self.best.odds:
            self.best = found
        return found.acceptable

    @property
    def refusal(self) -> str:
        """Why nothing will come of it; "" while something may."""
        if self._scans < TOLD_SCANS:
            return ""
        x_m, y_m, heading_rad = self.prior.pose.as_array().tolist()
        seen = len(self._tried)
        came_to = f"best odds {self.best.odds:.0f}" if self.best.points else "too few to tell"
        return (
            f"nothing agrees with the given pose, now {x_m:.1f} m, {y_m:.1f} m, {heading_rad:.2f} rad: "
            f"{seen} landmarks seen, {came_to}; the rover keeps its own pose"
        )

    @property
    def state(self) -> tuple[int, ...]:
        """What the next step depends on besides the prior, which follows from what was said and driven."""
        return (self._scans, len(self._tried))
