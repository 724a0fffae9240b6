"""Looks for the rover's place by the walls around it: the scans of each stretch of the way are laid onto every map."""

import math
import struct
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivers.measurements import FloatArray
from slam.joint.gaussian import JointGaussian
from slam.pose import Pose2
from slam.recognise.attempt import NOTHING, at_place
from slam.recognise.local_points import local_points
from slam.relocalise.island import Island
from slam.relocalise.local_map import ScanSeen
from slam.relocalise.search import Place
from slam.scan_search.agreement import Agreement
from slam.scan_search.ground import Plan
from slam.scan_search.laying import Laying
from slam.scan_search.stretch import Stretch

VIEWS_A_SECOND = 160  # are added to a plan
LOOKS_A_SECOND = 10_000_000  # cells looked up: about 3 % of one core
WITHIN_SIGMAS = 4.0  # of the pose in the own map, a place may be
REPLAN_M = 20.0  # of the way, after which more of the own map may be known to metres only
SHORTEST_S, LONGEST_S = 0.1, 1.0  # between two scans, for which work is done


class ByScans:
    """best_odds: of the places that are agreed on, in any map."""

    def __init__(self) -> None:
        self._source: JointGaussian | None = None
        self._stamp_ns = 0
        self._planned_m = 0.0
        self._forget()

    def step(self, seen: ScanSeen, source: JointGaussian, islands: Sequence[Island]) -> Place | None:
        """After every scan. source: what is around the rover; what was seen in another one is forgotten. islands: where
        it is looked for.
        """
        since_s = min(max(1e-9 * (seen.stamp_ns - self._stamp_ns), SHORTEST_S), LONGEST_S)
        self._stamp_ns = seen.stamp_ns
        if not islands or source is not self._source:
            self._source = source
            self._forget()
        if not islands:
            return None
        self._stretch.add(seen.increment_mean, seen.points_m)
        self._planned_m += seen.way_m
        for island in islands:
            is_stale = source is island.joint and self._planned_m > REPLAN_M
            if island.number not in self._plans or is_stale:
                self._plans[island.number], self._planned_m = Plan(island.views(source)), 0.0
            if not self._plans[island.number].advance(round(VIEWS_A_SECOND * since_s)):
                return None
        if self._laying is None and not self._begin(source, islands):
            return None
        return self._go_on(source, round(LOOKS_A_SECOND * since_s))

    @property
    def best_odds(self) -> float:
        """0 where there is no place yet."""
        return max((agreement.odds for agreement in self._agreements.values()), default=0.0)

    def state_bytes(self) -> bytes:
        """What the next step depends on, for a hash."""
        progress = () if self._laying is None else self._laying[1].state
        plans = (count for plan in self._plans.values() for count in (plan.added, plan.ground is not None))
        frame = self._stretch.frame_from_body.as_array().tolist()
        state = (*frame, self.best_odds, self._planned_m, *progress, *plans)
        return struct.pack(f"<{len(state)}d", *state)

    def _forget(self) -> None:
        self._stretch = Stretch()
        self._plans: dict[int, Plan] = {}
        self._agreements: dict[int, Agreement] = {}
        self._waiting: list[Island] = []
        self._laying: tuple[Island, Laying] | None = None
        self._points: FloatArray = np.zeros((0, 2))
        self._frame_from_body = Pose2()

    def _begin(self, source: JointGaussian, islands: Sequence[Island]) -> bool:
        """Lay a stretch onto one map after the other; onto the source's own one only where it may be in it."""
        if not self._waiting and self._stretch.is_due:
            self._points, self._frame_from_body = self._stretch.take(), self._stretch.frame_from_body
            self._waiting = list(islands)
        while self._waiting and self._laying is None:
            island = self._waiting.pop(0)
            plan = self._plans.get(island.number)
            ground = None if plan is None else plan.ground
            if ground is not None and source is island.joint:
                pose, sigma_m = source.map_from_body, math.sqrt(source.covariance[:2, :2].trace())
                ground = ground.near(pose.x_m, pose.y_m, WITHIN_SIGMAS * sigma_m)
            if ground is not None and len(ground.places):
                self._laying = (island, Laying(ground, self._points))
        return self._laying is not None

    def _go_on(self, source: JointGaussian, most_looks: int) -> Place | None:
        assert self._laying is not None
        island, laying = self._laying
        laid = laying.advance(most_looks)
        if laid is None:
            return None
        self._laying = None
        agreed = self._agreements.setdefault(island.number, Agreement()).add(laid, self._frame_from_body)
        if agreed is None:
            return None
        if source is island.joint:  # the next time, scans of their own have to agree
            del self._agreements[island.number]
        moved = self._frame_from_body.inverse() @ self._stretch.frame_from_body
        place = replace(
            NOTHING,
            map_from_body=agreed.map_from_body @ moved,
            odds=agreed.odds,
            mirror_odds=agreed.mirror_odds,
            by_scans=True,
        )
        index = island.index
        return Place(
            island, source, source.map_from_body, at_place(index, local_points(source.state, index.scale), place)
        )
