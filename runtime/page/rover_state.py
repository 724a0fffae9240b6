"""What the page knows of a rover: all that came over zenoh, decoded, bounded, and ready to be drawn.

Anyone may publish on the rover's keys: what makes no sense is passed over.
"""

import json
import math
from collections import deque
from itertools import islice
from typing import Any

import numpy as np

from drivers.measurements import FloatArray
from runtime.messages.definitions import deserialize
from runtime.messages.tick import decode
from runtime.printable import printable
from runtime.publish.follow import Message
from runtime.publish.rover_status import LARGEST_BYTES, believed
from runtime.ros2.markers import MARKERS
from runtime.ros2.poses import PATH
from slam.pose import Pose2, wrap_rad
from slam.settings.slam import MountSettings

HEARD = ("pose", "scan_full", "status", "landmarks", "event")
CELL_M = 0.2
MOST_CELLS = 60_000
STILL_NS, PAUSE_NS = 2_000_000_000, 1_500_000_000  # a cell is of the map once scans ended there for so long, with no
# longer pause: who walks by is in a cell for half a second
MOST_CANDIDATES = 20_000
PATH_SPACING_M = 0.1
MOST_PATH_POINTS = 20_000
MOST_BEAMS = 361
MOST_EVENTS = 12
MOST_LANDMARKS = 2000
FARTHEST_M = 1e5
POSES_KEPT = 30
SPEED_POSES = 10  # a second of them


class RoverState:
    """Owned by one thread. cells (steps of CELL_M) and path (m) only grow, so that a viewer needs but their ends.

    Cells are where scans ended for a while: who walks by leaves none. Both begin anew with the rover, as another
    generation.
    """

    def __init__(self, rover: str) -> None:
        self.rover = rover
        self.begin(MountSettings())
        self.generation = 0

    def begin(self, mount: MountSettings) -> None:
        """A rover has come: what was known before may be of another run."""
        self._mount = mount
        self._poses: deque[tuple[int, Pose2]] = deque(maxlen=POSES_KEPT)
        self._seen: set[int] = set()
        self._candidates: dict[int, tuple[int, int]] = {}  # when scans began to end there, and when one last did
        self.cells: list[tuple[int, int]] = []
        self.path: list[tuple[float, float]] = []
        self._pose: dict[str, float] | None = None
        self._scan: list[float] = []
        self._landmarks: list[float] = []
        self._status: dict[str, Any] | None = None
        self._events: deque[dict[str, Any]] = deque(maxlen=MOST_EVENTS)
        self._speed_mps = 0.0
        self.generation = getattr(self, "generation", 0) + 1

    def take(self, message: Message) -> None:
        """A message on one of the keys of HEARD, or the answer on path."""
        takers = {
            "pose": self._take_pose,
            "scan_full": self._take_scan,
            "status": self._take_status,
            "landmarks": self._take_landmarks,
            "event": self._take_event,
            "path": self._take_path,
        }
        try:
            with np.errstate(all="ignore"):  # a signalling NaN warns when it is made wider; none passes the checks
                takers[message.name](message.data)
        except (ValueError, IndexError, ArithmeticError, TypeError, KeyError, RecursionError):
            return  # a stranger's; the rover's own come ten times a second

    def beat(self, is_there: bool) -> dict[str, Any]:
        """All that is drawn anew each time."""
        return {
            "rover": self.rover,
            "there": is_there,
            "pose": self._pose,
            "speed_mps": round(self._speed_mps, 2),
            "scan": self._scan,
            "landmarks": self._landmarks,
            "status": self._status,
            "events": list(self._events),
        }

    def _take_pose(self, data: bytes) -> None:
        message = decode("/pose", data)
        at, turn = message.pose.pose.position, message.pose.pose.orientation
        pose = Pose2(at.x, at.y, wrap_rad(2.0 * math.atan2(turn.z, turn.w)))
        if not (np.abs(pose.as_array()) < FARTHEST_M).all():  # of NaN too
            return
        stamp_ns = _stamp_ns(message)
        variances = message.pose.covariance.reshape(6, 6)
        sigma_m = math.sqrt(max(0.0, float(variances[0, 0] + variances[1, 1])))
        if self._poses and stamp_ns > (before := self._poses[-min(SPEED_POSES, len(self._poses))])[0]:
            moved = before[1].inverse() @ pose
            self._speed_mps = math.hypot(moved.x_m, moved.y_m) / ((stamp_ns - before[0]) * 1e-9)
        self._poses.append((stamp_ns, pose))
        self._pose = {
            "x_m": round(pose.x_m, 3),
            "y_m": round(pose.y_m, 3),
            "heading_rad": round(pose.heading_rad, 4),
            "sigma_m": round(min(sigma_m, FARTHEST_M), 3),
        }
        last = self.path[-1] if self.path else None
        if last is None or math.dist(last, (pose.x_m, pose.y_m)) >= PATH_SPACING_M:
            self._extend_path(pose.x_m, pose.y_m)

    def _take_path(self, data: bytes) -> None:
        for stamped in deserialize(PATH, data).poses:
            at = stamped.pose.position
            if abs(at.x) < FARTHEST_M and abs(at.y) < FARTHEST_M:
                self._extend_path(at.x, at.y)

    def _extend_path(self, x_m: float, y_m: float) -> None:
        if len(self.path) < MOST_PATH_POINTS:
            self.path.append((round(x_m, 2), round(y_m, 2)))

    def _take_scan(self, data: bytes) -> None:
        message = decode("/scan", data)
        if not self._poses:
            return
        step = max(1, -(-len(message.ranges) // MOST_BEAMS))
        ranges_m = message.ranges[::step].astype(np.float64)
        bearings_rad = message.angle_min + message.angle_increment * step * np.arange(ranges_m.size)
        if self._mount.upside_down:
            bearings_rad = -bearings_rad
        returned = np.isfinite(ranges_m) & (ranges_m > message.range_min) & (ranges_m < 1e3)
        beams = ranges_m[returned, None] * np.stack((np.cos(bearings_rad), np.sin(bearings_rad)), -1)[returned]
        stamp_ns = _stamp_ns(message)
        pose = min(self._poses, key=lambda known: abs(known[0] - stamp_ns))[1]
        points_m = (pose @ self._mount.as_pose()).transform(beams)
        if np.isfinite(points_m).all():
            self._scan = points_m.round(2).ravel().tolist()
            self._add_cells(points_m, stamp_ns)

    def _add_cells(self, points_m: FloatArray, stamp_ns: int) -> None:
        if len(self._candidates) > MOST_CANDIDATES:
            fresh = ((key, span) for key, span in self._candidates.items() if 0 <= stamp_ns - span[1] <= PAUSE_NS)
            self._candidates = dict(islice(fresh, MOST_CANDIDATES // 2))
        for column, row in np.unique(np.floor(points_m / CELL_M).astype(np.int64), axis=0).tolist():
            key = (column << 32) ^ (row & 0xFFFFFFFF)
            if key in self._seen or len(self.cells) >= MOST_CELLS:
                continue
            began_ns, last_ns = self._candidates.get(key, (stamp_ns, stamp_ns))
            if not 0 <= stamp_ns - last_ns <= PAUSE_NS:
                began_ns = stamp_ns
            self._candidates[key] = (began_ns, stamp_ns)
            if stamp_ns - began_ns >= STILL_NS:
                del self._candidates[key]
                self._seen.add(key)
                self.cells.append((column, row))

    def _take_landmarks(self, data: bytes) -> None:
        markers = deserialize(MARKERS, data).markers[:1]
        points = [(point.x, point.y) for marker in markers for point in marker.points[:MOST_LANDMARKS]]
        flat = np.array(points, np.float64).ravel()
        if np.isfinite(flat).all():
            self._landmarks = flat.round(2).tolist()

    def _take_status(self, data: bytes) -> None:
        self._status = believed(f"infant/{self.rover}/status", data)

    def _take_event(self, data: bytes) -> None:
        if len(data) > LARGEST_BYTES:
            return
        event = json.loads(data)
        words = {name: printable(str(event[name]), 300) for name in ("source", "kind", "severity", "reason")}
        self._events.appendleft({"stamp_s": round(int(event["stamp_ns"]) * 1e-9, 1), **words})


def _stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)
