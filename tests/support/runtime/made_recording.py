"""A small recording in the format of the public ones, made in the simulated building."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from drivers.measurements import Scan
from drivers.simulated.world.places.building import Building, building_settings
from runtime.studies.places.building_drive import building_ticks

BEAMS = 541
DRIFT_RAD_PER_M = 0.02
RANGE_MAX_M = 30.0


def make_recording(data: Path, name: str, laps: float = 0.06, seed: int = 0) -> Path:
    """DATA/NAME of some seconds at 5 Hz: odometry as poses that drift, the truth, and the mount in the description."""
    building = Building(building_settings(seed, BEAMS))
    scans = [tick.scan for tick in building_ticks(building, 5.0, laps) if isinstance(tick.scan, Scan)]
    times_s = np.array([scan.stamp_ns * 1e-9 for scan in scans])
    points, headings = building.path.poses(times_s)
    way_m = building.path.arc_m(times_s)
    drifted = headings + DRIFT_RAD_PER_M * way_m
    step_m = np.diff(way_m, prepend=0.0)[:, None] * np.column_stack((np.cos(drifted), np.sin(drifted)))
    arrays: dict[str, Any] = {
        "scan_t": times_s,
        "ranges": np.array([np.nan_to_num(scan.ranges_m, nan=RANGE_MAX_M) for scan in scans], dtype=np.float32),
        "odom_t": times_s,
        "odom_pose": np.column_stack((np.cumsum(step_m, axis=0), drifted)),
        "gt_t": times_s,
        "gt_xy": points,
        "gt_theta": headings,
    }
    return _write(data, name, arrays, {"vehicle": {"laser_x": 0.3}, "gt_kind": "simulated, robot centre"})


def make_standing_recording(data: Path, name: str, scans: int = 60) -> Path:
    """DATA/NAME of a laser in a round room, past which a post walks to and fro; no odometry, no truth."""
    bearings = _bearings()
    ranges = np.full((scans, BEAMS), 5.0, dtype=np.float32)
    for k in range(scans):
        ranges[k, np.abs(bearings - 0.02 * k) < 0.06] = 2.0
    arrays = {"scan_t": 0.1 * np.arange(scans), "ranges": ranges}
    return _write(data, name, arrays, {"gt_kind": "none"})


def _bearings() -> Any:
    return -0.75 * np.pi + 1.5 * np.pi / (BEAMS - 1) * np.arange(BEAMS)


def _write(data: Path, name: str, arrays: dict[str, Any], more: dict[str, Any]) -> Path:
    meta = {
        "format": "ld2d-1",
        "name": name,
        "angle_min": -0.75 * np.pi,
        "angle_increment": 1.5 * np.pi / (BEAMS - 1),
        "range_max": RANGE_MAX_M,
        **more,
    }
    (data / name).mkdir(parents=True)
    np.savez_compressed(data / name / f"{name}.npz", meta=np.array(json.dumps(meta)), **arrays)
    return data / name
