"""How sharp a map the wheels alone draw: the measure by which two calibrations are compared on one drive.

Scans that are one to three keyframes (half a metre each at most) apart are laid over each other by dead reckoning.
The measure is the mean distance from a point of the later scan to the nearest point of the earlier one, each cut off at
0.3 m, so that what only one of them sees counts the same for everyone. Zero would be perfect; smaller is sharper.
"""

import numpy as np
from scipy.spatial import cKDTree

from drivers.measurements import FloatArray
from runtime.calibrate.drive_data import DriveData
from runtime.calibrate.scans.laser_motion import keyframes, laser_twists
from runtime.calibrate.scans.shapes import scan_points
from runtime.calibrate.wheel_model import WheelModel
from slam.pose import composed, inverted

CUT_M = 0.3
SPANS = (1, 2, 3)  # keyframes
POINTS = 250


def misfit_m(drive: DriveData, model: WheelModel, parameters: FloatArray, spans: tuple[int, ...] = SPANS) -> float:
    """Mean cut-off distance between scans placed by the wheels alone; NaN where the drive is too short."""
    series, stamps = drive.wheel_series(), drive.scan_times_s()
    wheels = model.dead_reckoning(series, parameters)
    times = stamps - parameters[-1]
    # the same scans for every calibration: keyframes by the start's account, inside what every latency allows
    believed = model.dead_reckoning(series, model.start)
    chosen = keyframes(believed, stamps, (stamps > series.times_s[0] + 0.5) & (stamps < series.times_s[-1] - 0.5))
    mount = parameters[-4:-1]
    poses = composed(wheels.at(times[chosen]), np.broadcast_to(mount, (len(chosen), 3)))
    twists = laser_twists(wheels, times[chosen], mount)
    clouds = [_cloud(drive, number, twist) for number, twist in zip(chosen, twists, strict=True)]
    trees = [cKDTree(cloud) if len(cloud) else None for cloud in clouds]
    means = []
    for span in spans:
        for index in range(len(chosen) - span):
            tree, later = trees[index], clouds[index + span]
            if tree is None or len(later) == 0:
                continue
            x, y, turn = composed(inverted(poses[index]), poses[index + span])
            rotation = np.array(((np.cos(turn), np.sin(turn)), (-np.sin(turn), np.cos(turn))))
            distances, _ = tree.query(later @ rotation + (x, y), distance_upper_bound=CUT_M)
            means.append(float(np.minimum(distances, CUT_M).mean()))
    return float(np.mean(means)) if means else float("nan")


def _cloud(drive: DriveData, number: int, twist: FloatArray) -> FloatArray:
    points, _, _ = scan_points(drive.scans[number], twist)
    return points[:: max(1, len(points) // POINTS)]
