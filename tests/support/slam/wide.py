"""One scan looked for on another, in a building."""

import numpy as np

from drivers.measurements import FloatArray, Scan
from slam.front_end.alignment_kernels import EarlierScans, surface_normals
from slam.front_end.alignment_search import Search
from slam.front_end.deskew import Beams, Twist, deskew
from slam.front_end.wide_search import View, WideSearch
from slam.pose import Pose2
from tests.support.slam.corridor import BEARINGS_RAD, RANGE_MAX_M, RANGE_SIGMA_M, ranges_of, ring_of_corridors

MOUNT = Pose2(0.1, 0.0, 0.0)
LINES = ring_of_corridors(2)
AT_A_CORNER = Pose2(20.0, 0.0, 0.3)
IN_A_CORRIDOR = Pose2(10.0, 0.0, 0.0)


def scan_at(pose: Pose2, number: int, lines: FloatArray = LINES, sigma_m: float = RANGE_SIGMA_M) -> Scan:
    """The scan of this number, three seconds after the one before."""
    noise = np.random.default_rng(number).normal(0.0, sigma_m, BEARINGS_RAD.size)
    ranges = (ranges_of(pose @ MOUNT, lines) + noise).astype(np.float32)
    return Scan(number * 3_000_000_000, ranges, BEARINGS_RAD, range_max_m=RANGE_MAX_M)


def search_between(last: Scan, new: Scan) -> WideSearch:
    """For the new scan on the last."""
    seen, now = beams_of(last), beams_of(new)
    normals = np.empty_like(seen.points_m)
    surface_normals(seen.points_m, seen.spacing_rad, normals)
    start = np.array(((-MOUNT.x_m, 0.0, 1.0, 0.0),))
    past = EarlierScans(seen.points_m[None], normals[None], start, float(BEARINGS_RAD[0]), seen.spacing_rad)
    points = now.points_m[~np.isnan(now.points_m[:, 0])]
    return WideSearch(Search(MOUNT.transform(points), past), View.of(now), View.of(seen), MOUNT)


def search_of(before: Pose2, after: Pose2, lines: FloatArray = LINES) -> WideSearch:
    """For the scan at one pose on that at another; lines: what the second one sees."""
    return search_between(scan_at(before, 1), scan_at(after, 2, lines))


def beams_of(scan: Scan) -> Beams:
    """As it was taken at rest."""
    return deskew(scan, Twist(), MOUNT, 0.1, 20.0)
