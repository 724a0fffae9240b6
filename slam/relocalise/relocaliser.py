"""Finds the way back by itself: looks for what is around the rover in the maps that it knows, and joins them.

Four occasions: the pose is in doubt (a local map is made from then on and looked for); nothing of the rooted map has
been seen for a while (the landmarks made since are looked for: a slip into unmapped country leaves nothing to be
missed); the position is known to metres only, as after a large loop; other maps are known. Landmarks are looked for as
constellations, and walls by the scans themselves. Work in a tick is bounded; a result is used at the scan that brings
it.
"""

import math
import struct

from drivers.measurements import IntArray
from slam.estimate import Quality, Recognition
from slam.joint.gaussian import JointGaussian
from slam.keyframes.keyframes import Keyframes
from slam.maps.start import MapStart, saved_map
from slam.maps.views import NO_VIEWS, Views
from slam.pose import Pose2, wrap_rad
from slam.quality import Judgement, QualityMonitor
from slam.recognise.local_points import local_points
from slam.recognise.map_index import MapIndex
from slam.recognise.prior import PosePrior
from slam.recognise.scale import Scale
from slam.relocalise.breakdown import broken_map, is_broken
from slam.relocalise.by_landmarks import ByLandmarks, Known
from slam.relocalise.by_scans import ByScans
from slam.relocalise.island import Island
from slam.relocalise.local_map import LocalMap, ScanSeen
from slam.relocalise.search import Place
from slam.settings.slam import SlamSettings

WIDE_M = 1.0  # sigma of the position, from which on the map is searched for what is around
FOLLOW_EVERY = 10  # scans, the index is brought up to date
MOST_CHANGES = 64  # of an index in a scan
NEW_MAP_M, NEW_MAP_NS = 30.0, 60_000_000_000  # lost on new ground for so long, a new map begins
LEAST_LANDMARKS = 6  # of a new map
MOST_ISLANDS = 8


class Relocaliser:
    """here: the map that the rover is in, from which the pose is published."""

    def __init__(
        self,
        settings: SlamSettings,
        joint: JointGaussian,
        saved: JointGaussian | None = None,
        saved_views: Views = NO_VIEWS,
    ) -> None:
        """saved: the map of an earlier drive, with its views; the same as joint where the pose in it is known."""
        self._settings = settings
        self._mount = settings.mount.as_pose()
        self._scale = Scale.of(settings)
        self._reach_m = settings.view.range_max_m + settings.view.range_margin_m
        self.here = self._island(1, joint)
        self.here.is_saved, self.awaits_saved = saved is joint, False
        if saved is joint:
            self.here.saved_views = saved_views
        if joint.scans:  # the drive begins in a map
            self.here.rooting.root(joint.scans, 0)
            self.here.follow(None)
        self._others: list[Island] = []
        self._last_number = 1
        self._local: LocalMap | None = None
        self._by_landmarks, self._by_scans = ByLandmarks(self._scale), ByScans()
        self._front_from_map: Pose2 | None = None
        self.recognised = 0
        if saved is not None and saved is not joint:
            self.add_map(saved, saved_views)

    def step(self, seen: ScanSeen, matched: IntArray, quality: QualityMonitor) -> Recognition | None:
        """After every scan. matched (K,): identities or verdicts that the joint Gaussian gave the features.

        On a recognition, or where a new map was begun, `here` is another map or another pose in it.
        """
        self._by_landmarks.follow(Pose2(*seen.increment_mean.tolist()))
        if not quality.is_doubted:
            self.here.take(seen.increment_mean, seen.laid, matched)
        self._follow_local(seen, quality)
        before = self.here.joint.map_from_body
        by_scans = self._look_by_scans(seen)
        place = self._look_by_landmarks(seen.stamp_ns) or by_scans
        recognition = None if place is None else self._go_to(place)
        recognition = recognition or self._new_map(seen.stamp_ns, quality)
        if recognition is not None:
            self._restart(before, quality, seen.stamp_ns)
        return recognition

    def begin_anew_where_broken(
        self, map_from_body: Pose2, quality: QualityMonitor, stamp_ns: int, start: MapStart | None
    ) -> Recognition | None:
        """Where the map that the rover is in is broken it goes on from this pose in a new one; the old one is kept as
        it is remembered, or as it was saved, to be recognised in.
        """
        broken, settings = self.here, self._settings
        if not broken_map(broken.joint):
            return None
        joint = JointGaussian(settings.joint, self._mount, settings.tuning())
        joint.state.mean[:3] = map_from_body.as_array()
        joint.scans, joint.moves = broken.joint.scans, broken.joint.moves
        broken.restore()
        if not broken_map(broken.joint):
            self.awaits_saved |= broken.is_saved
            self._put_aside(broken)
        elif broken.is_saved and start is not None:
            self.add_map(saved_map(settings, start), start.known.views)
        self._last_number += 1
        self.here = self._island(self._last_number, joint)
        self.here.rooting.root(joint.scans, 0)
        self._front_from_map = None
        self._restart(map_from_body, quality, stamp_ns)
        return Recognition(self.here.number, is_new=True)

    def tell(self, prior: PosePrior) -> None:
        """Somebody says where the rover was at its last scan: in the saved map, where it looks for its place in one,
        else in the map that it is in. It is looked for there, and believed where what stands around agrees.
        """
        self._by_landmarks.tell(prior)

    def take_refusal(self) -> str:
        """Why what somebody said is not believed, once; "" where nothing was refused."""
        return self._by_landmarks.take_refusal()

    def add_map(self, joint: JointGaussian, views: Views = NO_VIEWS) -> None:
        """One that was known before, to be recognised in; its landmarks' identities are below its number of scans."""
        self._last_number += 1
        island = self._island(self._last_number, joint)
        island.rooting.root(joint.scans, 0)
        island.is_saved = self.awaits_saved = True
        island.saved_views = views
        self._put_aside(island)

    def continuous(self, map_from_body: Pose2) -> Pose2:
        """The pose in a frame in which it never jumped, for whoever compares scans by it."""
        return map_from_body if self._front_from_map is None else self._front_from_map @ map_from_body

    @property
    def searching(self) -> str:
        """What the search has come to; "" where none is going on."""
        if self._local is None and not self._others:
            return ""
        walls = self._by_scans.best_odds
        by_walls = f"; walls agree, odds {walls:.0f}" if walls > 0.0 else ""
        return f"searching the map: {self._by_landmarks.progress}{by_walls}"

    def judged(self, judgement: Judgement) -> Judgement:
        """A pose that says nothing of where the rover is in the saved map is lost, however well it is known."""
        if self.awaits_saved:
            return Judgement(Quality.LOST, self.searching)
        doubts = (judgement.doubt, self.searching if judgement.doubt else "")
        return Judgement(judgement.quality, "; ".join(filter(None, doubts)))

    @property
    def lasting(self) -> Island:
        """The map that is kept when the drive ends: that of an earlier one, where there is one."""
        return next((island for island in (self.here, *self._others) if island.is_saved), self.here)

    @property
    def figures(self) -> dict[str, float]:
        """For the record: which map, what the last attempt reached, and what its mirror image did."""
        return {
            "map_id": float(self.here.number),
            "maps_known": float(1 + len(self._others)),
            "recognitions": float(self.recognised),
            **self._by_landmarks.figures,
            "search_scan_odds": self._by_scans.best_odds,
        }

    def state_bytes(self) -> bytes:
        """What the next step depends on, for a hash."""
        numbers = struct.pack("<3q", self.here.number, len(self._others), self.here.rooting.before_scan)
        local = b"" if self._local is None else self._local.joint.state_bytes()
        return numbers + local + self._by_landmarks.state_bytes() + self._by_scans.state_bytes()

    def _island(self, number: int, joint: JointGaussian) -> Island:
        return Island(number, joint, Keyframes(joint, self._mount), MapIndex(self._scale))

    def _follow_local(self, seen: ScanSeen, quality: QualityMonitor) -> None:
        """Keep a local map while the pose is in doubt or somebody says another; it begins anew where it is spoilt or
        has missed a step.
        """
        joint = self.here.joint
        if not quality.is_doubted and (not self._by_landmarks.is_told or self.awaits_saved):
            if self._local is not None:
                self._local = None
                self._by_landmarks.forget(self._islands)
            return
        local = self._local
        first = local is None or local.is_spoilt or local.joint.moves != joint.moves - 1 or is_broken(local.joint.state)
        if local is None or first:
            settings = self._settings
            made = JointGaussian(settings.joint, self._mount, settings.tuning())
            keyframes, monitor = Keyframes(made, self._mount), QualityMonitor(settings.quality)
            begun = LocalMap(made, keyframes, monitor, joint, seen.stamp_ns)
            if local is not None:
                begun.since_ns, begun.driven_m = local.since_ns, local.driven_m
            self._local = local = begun
            self._by_landmarks.forget(self._islands)
        local.follow(seen, first=first)

    @property
    def _islands(self) -> tuple[Island, ...]:
        return (self.here, *self._others)

    @property
    def _source(self) -> JointGaussian:
        """What is around the rover, as far as it can be believed."""
        return self.here.joint if self._local is None else self._local.joint

    def _look_by_landmarks(self, stamp_ns: int) -> Place | None:
        here = self.here
        is_current = True
        if here.joint.scans % FOLLOW_EVERY == 0 or self._local is not None:
            is_current = here.follow(MOST_CHANGES)
        known = Known(here, self._others, self._source, self.awaits_saved)
        return self._by_landmarks.step(stamp_ns, known, may_begin=is_current)

    def _look_by_scans(self, seen: ScanSeen) -> Place | None:
        """While the place in a map is not known, that is looked for in which it may be; while it is known to metres
        only, the rest of that map is.
        """
        islands = self._islands
        if self._local is None:
            here = self.here
            is_wide = math.sqrt(here.joint.covariance[:2, :2].trace()) > WIDE_M
            islands = ((here,) if is_wide else ()) + (() if here.is_saved else tuple(self._others))
        else:
            seen = self._local.as_moved(seen)
        return self._by_scans.step(seen, self._source, islands)

    def _go_to(self, place: Place) -> Recognition | None:
        """The rover goes on at a place in a map."""
        island, source, found = place.island, place.source, place.found
        pose = found.map_from_body @ place.frame_from_body.inverse() @ source.map_from_body
        here = self.here
        before = here.joint.map_from_body
        if source is island.joint and found.by_scans:
            done = island.close_by_walls(pose) if island.expects(pose) else None
        elif source is island.joint and island.expects(pose):
            done = island.close_loop(found)
        else:
            done = island.take_in(source, self._reach_m, found, pose)
        if done is None:
            return None
        joined = 0
        if island is not here:
            self._others.remove(island)
            if source is here.joint:
                joined = here.number
            else:
                self._put_aside(here)
            self.here = island
        self.recognised += 1
        self.awaits_saved = self.awaits_saved and not island.is_saved
        off = before.inverse() @ self.here.joint.map_from_body
        return Recognition(
            self.here.number,
            joined=joined,
            odds=found.odds,
            mirror_odds=found.mirror_odds,
            probability_wrong=found.probability_wrong,
            by_scans=found.by_scans,
            matches=len(done.kept),
            moved_m=math.hypot(off.x_m, off.y_m),
            turned_rad=wrap_rad(off.heading_rad),
        )

    def _new_map(self, stamp_ns: int, quality: QualityMonitor) -> Recognition | None:
        """Lost for long on ground that no map has: the local map becomes the one that is published."""
        local = self._local
        if local is None or not quality.map_is_kept or local.is_spoilt:
            return None
        if local.driven_m < NEW_MAP_M and stamp_ns - local.since_ns < NEW_MAP_NS:
            return None
        if len(local_points(local.joint.state, self._scale)) < LEAST_LANDMARKS:
            return None
        self.awaits_saved |= self.here.is_saved and quality.is_told  # who was told wrongly was told nothing
        self._put_aside(self.here)
        self._last_number += 1
        self.here = Island(self._last_number, local.joint, local.keyframes, MapIndex(self._scale))
        self.here.rooting.root(local.joint.scans, len(local.keyframes))
        return Recognition(self.here.number, is_new=True)

    def _put_aside(self, island: Island) -> None:
        """Keep a map to be recognised in, without what may be a ghost; beyond MOST_ISLANDS the smallest goes."""
        island.restore()
        island.follow(None)
        self._others.append(island)
        if len(self._others) > MOST_ISLANDS:
            self._others.remove(min(self._others, key=lambda other: (other.is_saved, len(other.index))))

    def _restart(self, before: Pose2, quality: QualityMonitor, stamp_ns: int) -> None:
        """Everything that remembers the pose of before goes on from the one of now."""
        after = self.here.joint.map_from_body
        self._front_from_map = (self._front_from_map or Pose2()) @ before @ after.inverse()
        self._local = None
        self.here.remember()
        self._by_landmarks.restart(self._islands)
        quality.restart(stamp_ns)
