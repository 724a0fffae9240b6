"""The occupancy grid of a run, made in the same pass as everything else, of as few scans as show it."""

from drivers.measurements import Scan, ScanLike
from runtime.maps.placed_scans import at_scan, place, twist_between
from slam.estimate import Estimate, Quality
from slam.maps.occupancy_grid import GridMap, OccupancyGrid
from slam.pose import Pose2, wrap_rad
from slam.settings.slam import SlamSettings

MOST_CELLS = 18_000_000  # 144 MB of counts, twice that while they grow: 420 m by 420 m at 0.1 m
APART_M, APART_RAD, APART_NS = 0.2, 0.2, 5_000_000_000  # a scan from nearer than this shows little that is new


class GridOfRun:
    """Takes a run tick by tick. A grid that would become too large is given up: full is then true."""

    def __init__(self, settings: SlamSettings, resolution_m: float) -> None:
        self._settings = settings
        self._grid = OccupancyGrid(resolution_m, MOST_CELLS)
        self._before: Estimate | None = None
        self._used: tuple[int, Pose2] | None = None
        self.full = False

    def add(self, scan: ScanLike | None, estimate: Estimate) -> None:
        """The scan of one tick, where its pose is believed and it shows something new."""
        before, self._before = self._before, estimate
        if self.full or not isinstance(scan, Scan) or estimate.beam_verdicts is None:
            return
        if estimate.quality is Quality.LOST:
            return
        pose = at_scan(scan.stamp_ns, before, estimate)
        if self._used is not None and not _apart(self._used, scan.stamp_ns, pose):
            return
        self._used = scan.stamp_ns, pose
        placed = place(scan, pose, twist_between(before, estimate), estimate.beam_verdicts, self._settings)
        try:
            self._grid.add(placed.sensor_m, placed.points_m, placed.solid)
        except MemoryError:
            self.full = True

    def grid_map(self) -> GridMap | None:
        """None where there is none to show."""
        return self._grid.grid_map() if self._grid.scans else None


def _apart(used: tuple[int, Pose2], stamp_ns: int, pose: Pose2) -> bool:
    used_ns, used_pose = used
    moved = max(abs(pose.x_m - used_pose.x_m), abs(pose.y_m - used_pose.y_m))
    turned = abs(wrap_rad(pose.heading_rad - used_pose.heading_rad))
    return stamp_ns - used_ns >= APART_NS or moved >= APART_M or turned >= APART_RAD
