"""What a drive leaves behind as numbers that JSON can hold."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from drivers.measurements import FloatArray
from runtime.evaluate.errors import trajectory_error

MILLIMETRE = 3


def path_figures(paths: Mapping[str, FloatArray], truth: FloatArray) -> dict[str, float]:
    """Both errors of every path (n, 3): largest and RMS in the frame of the start pose, and after the rigid fit."""
    figures = {}
    for name, path in paths.items():
        error = trajectory_error(path, truth)
        figures[f"{name}_largest_m"] = error.from_start.largest_m
        figures[f"{name}_rms_m"] = error.from_start.rms_m
        figures[f"{name}_aligned_largest_m"] = error.aligned.largest_m
        figures[f"{name}_aligned_rms_m"] = error.aligned.rms_m
    return figures


def joined(paths: Mapping[str, FloatArray], truth: FloatArray) -> dict[str, Any]:
    """Positions of all paths and the truth, (n, 2) each, to the millimetre."""
    return {name: np.round(path[:, :2], MILLIMETRE).tolist() for name, path in {**paths, "truth": truth}.items()}
