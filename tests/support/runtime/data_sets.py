"""Small data sets of the format ld2d-1, as files."""

import json
from pathlib import Path
from typing import Any

import numpy as np

META = {"name": "victoria_park", "angle_min": -1.0, "angle_increment": 0.5, "range_max": 10.0}
SCANS: dict[str, Any] = {
    "scan_t": np.array([100.0, 100.2, 101.0]),
    "ranges": np.array(
        [[1.0, 2.0, 3.0, 4.0, 5.0], [0.0, -1.0, np.inf, np.nan, 10.0], [9.999, 10.1, 1.0, 1.0, 1.0]], np.float32
    ),
}
POSES: dict[str, Any] = {
    "odom_t": np.linspace(99.95, 101.5, 32),
    "odom_pose": np.column_stack((np.linspace(0.0, 0.8, 32), np.zeros(32), np.zeros(32))),
}


def write_set(folder: Path, arrays: dict[str, Any], meta: dict[str, Any] | None = None) -> Path:
    """FOLDER/FOLDER.npz with META and meta in it; {}: without a description."""
    folder.mkdir()
    described: dict[str, Any] = {} if meta == {} else {"meta": np.array(json.dumps(META | (meta or {})))}
    np.savez(folder / f"{folder.name}.npz", **(described | arrays))
    return folder
