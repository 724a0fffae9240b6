"""An occupancy grid of a rover that drives, made of what it says over zenoh in a process of its own.

The rover's loop knows nothing of it. Anyone may publish on the rover's keys: what makes no sense is passed over.
Work is bounded: a scan when one comes (publish.scan_hz), a picture of the grid once a second, and at most MOST_CELLS
cells.
"""

import threading
import time
from collections import deque
from itertools import pairwise
from typing import Any, TextIO

import numpy as np
import zenoh

from drivers.measurements import Scan, uniform_bearings
from runtime.errors import SensorError, UsageError
from runtime.maps.grid_message import GRID, grid_bytes
from runtime.messages.tick import decode
from runtime.printable import printable, tell
from runtime.publish.follow import Follower
from runtime.publish.rover_status import ROVER
from runtime.publish.session import short_reason, tool_session
from runtime.settings.configuration import load_configuration_text
from slam.front_end.deskew import Twist, deskew
from slam.maps.occupancy_grid import OccupancyGrid
from slam.pose import Pose2, wrap_rad
from slam.quality import LOST_M
from slam.settings.slam import SlamSettings

GRID_S = 1.0
MOST_CELLS = 25_000_000  # 200 MB of counts: 250 m by 250 m at 0.05 m
POSES_KEPT = 100  # ten seconds at 10 Hz, for scans that come late
WAKE_S = 0.2
FARTHEST_M = 1e6  # where no rover drives, and cells of a grid still have numbers


class LiveGrid:
    """Places scans by the poses around them and counts them; all stamps are the rover's wall time.

    troubles: what went wrong, a sentence for each kind.
    """

    def __init__(self, settings: SlamSettings, resolution_m: float) -> None:
        self._settings = settings
        self._poses: deque[tuple[int, Pose2, bool]] = deque(maxlen=POSES_KEPT)
        self.grid = OccupancyGrid(resolution_m, MOST_CELLS)
        self.troubles: dict[str, str] = {}

    def take(self, name: str, data: bytes) -> None:
        """A message on the rover's key of this name, "pose" or "scan"."""
        try:
            message = decode(f"/{name}", data)
            if name == "pose":
                self.add_pose(message)
            else:
                self.add_scan(message)
        except (ValueError, IndexError, ArithmeticError) as error:
            self.troubles.setdefault(name, f"a {name} that no rover sends is ignored: {printable(str(error), 200)}")

    def add_pose(self, message: Any) -> None:
        """geometry_msgs/PoseWithCovarianceStamped."""
        variances = message.pose.covariance.reshape(6, 6)
        at, turn = message.pose.pose.position, message.pose.pose.orientation
        pose = Pose2(at.x, at.y, wrap_rad(2.0 * float(np.arctan2(turn.z, turn.w))))
        is_near = bool((np.abs(pose.as_array()) < FARTHEST_M).all())  # false for NaN
        known = is_near and bool(max(variances[0, 0], variances[1, 1]) < LOST_M**2)
        self._poses.append((stamp_of(message), pose, known))

    def add_scan(self, message: Any) -> bool:
        """sensor_msgs/LaserScan; False where no pose is near it that could be believed."""
        stamp_ns = stamp_of(message)
        placed = self._placed(stamp_ns)
        if placed is None:
            return False
        pose, twist = placed
        ranges = message.ranges.copy()
        bearings = uniform_bearings(message.angle_min, message.angle_increment, len(ranges))
        first, period_s = 0, message.time_increment
        if message.angle_increment < 0.0:  # measured clockwise; our arrays are counter-clockwise
            ranges, bearings = ranges[::-1].copy(), bearings[::-1].copy()
            first, period_s = len(ranges) - 1, -period_s
        scan = Scan(stamp_ns, ranges, bearings, period_s, first, message.range_max)
        mount, front_end = self._settings.mount, self._settings.front_end
        beams = deskew(mount.upright(scan), twist, mount.as_pose(), front_end.range_min_m, front_end.range_max_m)
        map_from_laser = pose @ mount.as_pose()
        returned = np.isfinite(beams.ranges_m) & np.isfinite(beams.points_m).all(axis=1)
        points = map_from_laser.transform(beams.points_m[returned])
        try:
            self.grid.add(map_from_laser.as_array()[:2], points, np.ones(len(points), dtype=np.bool_))
        except MemoryError as error:
            text = f"the grid would have {error}: scans that reach so far are ignored; give a coarser --resolution"
            self.troubles.setdefault("size", text)
            return False
        return True

    def _placed(self, stamp_ns: int) -> tuple[Pose2, Twist] | None:
        """The pose at a time between two that were published, and the motion between them."""
        for (before_ns, before, knew), (after_ns, after, knows) in pairwise(self._poses):
            if before_ns <= stamp_ns <= after_ns and before_ns < after_ns:
                if not (knew and knows):
                    return None
                step, share = before.inverse() @ after, (stamp_ns - before_ns) / (after_ns - before_ns)
                per_s = 1e9 / (after_ns - before_ns)
                part = Pose2(share * step.x_m, share * step.y_m, share * step.heading_rad)
                return before @ part, Twist(step.x_m * per_s, step.y_m * per_s, step.heading_rad * per_s)
        return None


def stamp_of(message: Any) -> int:
    """Nanoseconds in the header of a ROS message."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def publish_live_grid(
    endpoint: str, rover: str, resolution_m: float, config_file: str | None, stop: threading.Event, said: TextIO
) -> int:
    """Listen to a rover and say its grid on infant/<rover>/grid once a second until `stop`; returns how often it did.

    said: gets each kind of trouble once. Raises SensorError where nobody answers, ConfigurationError where config_file
    cannot be used, UsageError where no rover can have this name.
    """
    if not ROVER.fullmatch(rover):
        raise UsageError(f"--rover {rover!r}: expected a name of 1 to 32 letters, digits, - and _")
    try:
        with tool_session(endpoint, config_file) as session:
            follower = Follower(session, rover, ("pose", "scan"))
            live = LiveGrid(_settings_of(follower, endpoint), resolution_m)
            return _publish(session, follower, live, stop, said)
    except zenoh.ZError as error:
        raise SensorError(f"{endpoint}: no connection ({short_reason(error)}); give --connect and --zenoh") from error


def _publish(session: zenoh.Session, follower: Follower, live: LiveGrid, stop: threading.Event, said: TextIO) -> int:
    publisher = session.declare_publisher(
        f"infant/{follower.rover}/grid",
        encoding=zenoh.Encoding(f"application/cdr;{GRID}"),
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.DATA_LOW,
    )
    sent, troubles, next_s = 0, 0, time.monotonic() + GRID_S
    while not stop.is_set():
        if (message := follower.next(WAKE_S)) is not None:
            live.take(message.name, message.data)
        for text in list(live.troubles.values())[troubles:]:
            troubles += 1
            tell(said, f"infant: {text}\n")
        if time.monotonic() >= next_s and live.grid.scans:
            publisher.put(grid_bytes(live.grid.grid_map(), time.time_ns()))
            sent, next_s = sent + 1, time.monotonic() + GRID_S
    return sent


def _settings_of(follower: Follower, endpoint: str) -> SlamSettings:
    """Where the laser sits, from the configuration that the rover says it has."""
    text = follower.ask("configuration")
    if text is None:
        raise SensorError(
            f"{follower.rover} does not answer at {endpoint}; start it with infant run, and check its name"
        )
    source = f"configuration of {follower.rover}"
    return load_configuration_text(text.decode(errors="replace"), source=source).slam
