"""Finds the way back by itself: looks for what is around the rover in the maps that it knows, and joins them.

Three occasions: the pose is in doubt (a local map is made from then on and looked for); nothing of the rooted map has
been seen for a while (the landmarks made since are looked for every REVISIT_M: a slip into unmapped country leaves
nothing to be missed); other maps are known. Work in a tick is bounded; a result is used at the scan that brings it.
"""

import math
import struct

from drivers.measurements import IntArray
from slam.estimate import Quality, Recognition
from slam.joint.gaussian import JointGaussian
from slam.keyframes.keyframes import Keyframes
from slam.pose import Pose2, wrap_rad
from slam.quality import Judgement, QualityMonitor
from slam.recognise.attempt import NOTHING, Hypothesis
from slam.recognise.confirmation import Confirmation
from slam.recognise.local_points import local_points
from slam.recognise.map_index import MapIndex
from slam.recognise.prior import PosePrior
from slam.recognise.scale import Scale
from slam.relocalise.island import Island
from slam.relocalise.local_map import LocalMap, ScanSeen
from slam.relocalise.search import Search, ToldPlace, begin_search
from slam.settings.slam import SlamSettings

REVISIT_M = 10.0  # between attempts while the pose is believed
CONFIRM_M = 5.0  # the same after one that may be right
ATTEMPT_NS = 500_000_000  # between attempts in doubt
FOLLOW_EVERY = 10  # scans, the index is brought up to date
REMEMBER_EVERY = 10  # scans, at the least, the map is copied while it is right
MOST_CHANGES = 64  # of an index in a scan
NEW_MAP_M, NEW_MAP_NS = 30.0, 60_000_000_000  # lost on new ground for so long, a new map begins
LEAST_LANDMARKS = 6  # of a new map
MOST_ISLANDS = 8


class Relocaliser:
    """here: the map that the rover is in, from which the pose is published."""

    def __init__(self, settings: SlamSettings, joint: JointGaussian, saved: JointGaussian | None = None) -> None:
        """saved: the map of an earlier drive; the same as joint where the pose in it is known."""
        self._settings = settings
        self._mount = settings.mount.as_pose()
        self._scale = Scale.of(settings)
        self._reach_m = settings.view.range_max_m + settings.view.range_margin_m
        self.here = self._island(1, joint)
        self.here.is_saved, self.awaits_saved = saved is joint, False
        if joint.scans:  # the drive begins in a map
            self.here.rooting.root(joint.scans, 0)
            self.here.follow(None)
        self._others: list[Island] = []
        self._last_number, self._turn = 1, 0
        self._local: LocalMap | None = None
        self._search: Search | None = None
        self._told: ToldPlace | None = None
        self._refusal = ""
        self._since_attempt_m, self._attempt_ns = 0.0, 0
        self._front_from_map: Pose2 | None = None
        self.best, self.recognised = NOTHING, 0
        if saved is not None and saved is not joint:
            self.add_map(saved)

    def step(self, seen: ScanSeen, matched: IntArray, quality: QualityMonitor) -> Recognition | None:
        """After every scan. matched (K,): identities or verdicts that the joint Gaussian gave the features.

        On a recognition, or where a new map was begun, `here` is another map or another pose in it.
        """
        here, joint = self.here, self.here.joint
        if self._told is not None:
            self._told.follow(Pose2(*seen.increment_mean.tolist()))
        self._since_attempt_m += math.hypot(*seen.increment_mean[:2].tolist())
        keyframes = len(here.keyframes)
        if not quality.is_doubted and here.rooting.add(joint.scans, matched, joint.landmark_count, keyframes):
            here.remember(REMEMBER_EVERY)
        self._follow_local(seen, quality)
        before = joint.map_from_body
        recognition = self._look(seen.stamp_ns) or self._new_map(seen.stamp_ns, quality)
        if recognition is not None:
            self._restart(before, quality, seen.stamp_ns)
        return recognition

    def tell(self, prior: PosePrior) -> None:
        """Somebody says where the rover was at its last scan: in the saved map, where it looks for its place in one,
        else in the map that it is in. It is looked for there, and believed where what stands around agrees.
        """
        self._told, self._search = ToldPlace(prior), None

    def take_refusal(self) -> str:
        """Why what somebody said is not believed, once; "" where nothing was refused."""
        refusal, self._refusal = self._refusal, ""
        return refusal

    def add_map(self, joint: JointGaussian) -> None:
        """One that was known before, to be recognised in; its landmarks' identities are below its number of scans."""
        self._last_number += 1
        island = self._island(self._last_number, joint)
        island.rooting.root(joint.scans, 0)
        island.is_saved = self.awaits_saved = True
        self._put_aside(island)

    def continuous(self, map_from_body: Pose2) -> Pose2:
        """The pose in a frame in which it never jumped, for whoever compares scans by it."""
        return map_from_body if self._front_from_map is None else self._front_from_map @ map_from_body

    @property
    def searching(self) -> str:
        """What the search has come to; "" where none is going on."""
        if self._local is None and not self._others:
            return ""
        odds = f"best odds {self.best.odds:.0f}" if math.isfinite(self.best.odds) else "too few to tell"
        return f"searching the map: {self.best.points} landmarks seen, {odds}"

    def judged(self, judgement: Judgement) -> Judgement:
        """A pose that says nothing of where the rover is in the saved map is lost, however well it is known."""
        if self.awaits_saved:
            return Judgement(Quality.LOST, self.searching)
        doubts = (judgement.doubt, self.searching if judgement.doubt else "")
        return Judgement(judgement.quality, "; ".join(filter(None, doubts)))

    @property
    def lasting(self) -> JointGaussian:
        """The map that is kept when the drive ends: that of an earlier one, where there is one."""
        return next((island.joint for island in (self.here, *self._others) if island.is_saved), self.here.joint)

    @property
    def figures(self) -> dict[str, float]:
        """For the record: which map, what the last attempt reached, and what its mirror image did."""
        best = self.best
        tried = math.isfinite(best.odds)
        return {
            "map_id": float(self.here.number),
            "maps_known": float(1 + len(self._others)),
            "recognitions": float(self.recognised),
            "search_landmarks": float(best.points),
            "search_odds": best.odds if tried else 0.0,
            "search_mirror_odds": best.mirror_odds if math.isfinite(best.mirror_odds) else 0.0,
        }

    def state_bytes(self) -> bytes:
        """What the next step depends on, for a hash."""
        progress = () if self._search is None else self._search.attempt.state
        numbers = (self.here.number, len(self._others), self.here.rooting.before_scan, self._turn, self._attempt_ns)
        local = b"" if self._local is None else self._local.joint.state_bytes()
        counts = struct.pack(f"<{len(numbers) + len(progress)}q", *numbers, *progress)
        told = b"" if self._told is None else struct.pack("<2q3d", *self._told.state, *self._told.prior.pose.as_array())
        return counts + struct.pack("<dd", self._since_attempt_m, self.best.odds) + local + told

    def _island(self, number: int, joint: JointGaussian) -> Island:
        return Island(number, joint, Keyframes(joint, self._mount), MapIndex(self._scale))

    def _follow_local(self, seen: ScanSeen, quality: QualityMonitor) -> None:
        """Keep a local map while the pose is in doubt or somebody says another; it begins anew where it is spoilt or
        has missed a step.
        """
        joint = self.here.joint
        if not quality.is_doubted and (self._told is None or self.awaits_saved):
            if self._local is not None:
                self._local, self._search = None, None
                self._forget_attempts()
            return
        local = self._local
        first = local is None or local.is_spoilt or local.joint.moves != joint.moves - 1
        if local is None or first:
            settings = self._settings
            made = JointGaussian(settings.joint, self._mount, settings.tuning())
            begun = LocalMap(made, QualityMonitor(settings.quality), joint, seen.stamp_ns)
            if local is not None:
                begun.since_ns, begun.driven_m = local.since_ns, local.driven_m
            self._local, self._search = begun, None
            self._forget_attempts()
            local = begun
        local.follow(seen, first=first)

    def _forget_attempts(self) -> None:
        """The source is another one: what it reached says nothing of this one."""
        self.best, self._attempt_ns = NOTHING, 0
        for island in (self.here, *self._others):
            island.confirmation, island.tried = Confirmation(), ()

    def _look(self, stamp_ns: int) -> Recognition | None:
        """Begin an attempt where one is due, or go on with it."""
        here = self.here
        is_current = True
        if here.joint.scans % FOLLOW_EVERY == 0 or self._local is not None:
            is_current = here.follow(MOST_CHANGES)
        if self._search is None and is_current:
            self._search = self._next_search(stamp_ns)
        if self._search is None:
            return None
        found = self._search.attempt.advance()
        if found is None:
            return None
        search, self._search = self._search, None
        self.best = found
        if search.is_told:
            return self._take(search, found) if self._told is not None and self._told.add(found) else None
        if search.island.confirmation.add(found, search.frame_from_body):
            return self._take(search, found)
        if not search.whole:
            self._search = begin_search(self._scale, search.source, search.island, whole=True)
        return None

    def _next_search(self, stamp_ns: int) -> Search | None:
        """What is looked for, and in which map: they take turns."""
        here, local = self.here, self._local
        if self._told is not None:
            return self._next_told(self._told)
        source = here.joint if local is None else local.joint
        islands = [here, *self._others]
        if local is None:
            is_due = self._since_attempt_m >= (CONFIRM_M if self.best.acceptable else REVISIT_M)
            others = [] if here.is_saved else self._others
            islands = [here, *others] if is_due else others
        if not islands or (stamp_ns - self._attempt_ns < ATTEMPT_NS and self._attempt_ns <= stamp_ns):
            return None
        island = islands[self._turn % len(islands)]
        self._turn += 1
        self._attempt_ns = stamp_ns
        if local is None and island is here:
            self._since_attempt_m = 0.0
        return begin_search(self._scale, source, island, whole=False)

    def _next_told(self, told: ToldPlace) -> Search | None:
        """Look where the rover is said to be; that ends when it was looked for long enough."""
        self._refusal = told.refusal
        if self._refusal:
            self._told = None
            return None
        saved = next((island for island in self._others if self.awaits_saved and island.is_saved), self.here)
        source = self.here.joint if self._local is None else self._local.joint
        return told.begin(self._scale, source, saved) if source is not saved.joint else None

    def _take(self, search: Search, found: Hypothesis) -> Recognition | None:
        """The place is confirmed: the rover goes on in that map."""
        here, island, source = self.here, search.island, search.source
        before = here.joint.map_from_body
        pose = found.map_from_body @ search.frame_from_body.inverse() @ source.map_from_body
        if source is island.joint and island.expects(pose):
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
        self._put_aside(self.here)
        self._last_number += 1
        self.here = self._island(self._last_number, local.joint)
        self.here.rooting.root(local.joint.scans, 0)
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
        front = Pose2() if self._front_from_map is None else self._front_from_map
        self._front_from_map = front @ before @ after.inverse()
        self._local, self._search, self._told = None, None, None
        self.here.remember()
        self._forget_attempts()
        self._since_attempt_m = 0.0
        quality.restart(stamp_ns)
