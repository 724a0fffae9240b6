"""Whether the arrays of a data set have the form that they must have; rows that say nothing are left out.

Times rise strictly, poses and speeds are finite numbers, arrays that belong together are equally long.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import LARGEST_SPAN_RAD, BoolArray
from runtime.errors import DataSetError
from runtime.importers.parsing.clock_steps import longest_rising
from runtime.importers.parsing.left_out import LeftOut

Arrays = Mapping[str, NDArray[Any]]

ANY = 0  # so many columns as there are beams
Columns = tuple[int, ...]

SCANS: dict[str, Columns] = {
    "scan_t": (),
    "ranges": (ANY,),
    "scan_odom_pose": (3,),
    "scan_angle_min": (),
    "scan_angle_increment": (),
    "scan_beams": (),
}
ODOMETRY: dict[str, Columns] = {
    "odom_t": (),
    "odom_pose": (3,),
    "odom_v": (),
    "odom_w": (),
    "odom_steer": (),
    "odom_steer_cal": (),
    "odom_wheel": (2,),
    "odom_ticks": (2,),
    "odom_valid": (),
    "odom_unbroken": (),
}
SIGHTINGS: dict[str, Columns] = {"obs_t": (), "obs_id": (), "obs_range": (), "obs_bearing": ()}
TRUTH: dict[str, Columns] = {"gt_t": (), "gt_xy": (2,), "gt_theta": (), "gt_good": ()}
RELATIONS: dict[str, Columns] = {"rel": (8,)}
LANDMARKS: dict[str, Columns] = {"landmarks": (2,), "landmark_id": ()}
GROUPS: dict[str, dict[str, Columns]] = {
    "scans": SCANS,
    "odometry samples": ODOMETRY,
    "sightings": SIGHTINGS,
    "rows of the truth": TRUTH,
    "relations": RELATIONS,
    "landmarks": LANDMARKS,
}
KNOWN = frozenset(name for group in GROUPS.values() for name in group)
BEAMS = ("scan_angle_min", "scan_angle_increment", "scan_beams")
MAY_BE_NAN = ("ranges",)
LARGEST = 1e12
WITHIN = {
    "angle_min": (-LARGEST_SPAN_RAD, LARGEST_SPAN_RAD),
    "angle_increment": (-LARGEST_SPAN_RAD, LARGEST_SPAN_RAD),
    "range_max": (1e-3, 1e6),  # m
    "range_min": (0.0, 1e6),
    "time_increment": (0.0, 1.0),  # s
}
FARTHEST_S = 30.0 * 86_400.0  # from the middle of all stamps: no recording is so long
LATEST_S = 4e9  # seconds since 1970 in the year 2096: what is later was not written in seconds
REQUIRED = {"scan_t": ("ranges",), "obs_t": ("obs_range", "obs_bearing")}


def checked(path: Path, arrays: Arrays, meta: Mapping[str, Any], left_out: LeftOut) -> dict[str, NDArray[Any]]:
    """The known arrays with the rows that can be used, without empty ones. Raises DataSetError with the first that has
    another form.
    """
    kept: dict[str, NDArray[Any]] = {}
    for what, group in GROUPS.items():
        first = next(iter(group))
        present = {name: arrays[name] for name in group if name in arrays}
        for name, array in present.items():
            _check_form(path, name, array, group[name])
        if not present or first not in present:
            if present and group in (SCANS, ODOMETRY, SIGHTINGS) and set(present) != {"scan_odom_pose"}:
                raise DataSetError(
                    f"{path} has {next(iter(present))} but no {first}: the time of measurement is unknown"
                )
            if present and group is TRUTH:
                left_out.warnings.append(f"the truth is left out: {next(iter(present))} has no times (array gt_t)")
            continue
        for name, array in present.items():
            if len(array) != len(present[first]):
                raise DataSetError(
                    f"{path}: {name} has {len(array)} rows and {first} has {len(present[first])}; they must "
                    "have the same length"
                )
        if lacking := [name for name in REQUIRED.get(first, ()) if name not in present]:
            raise DataSetError(f"{path} has {first} but no {lacking[0]}; nothing was written")
        rows = _usable(path, what, first, present, left_out)
        kept |= {name: array[rows] for name, array in present.items()}
    if "scan_t" in kept:
        check_laser(path, kept, meta)
    return {name: array for name, array in kept.items() if len(array)}


def number(place: object, name: str, value: Any, least: float = -LARGEST, most: float = LARGEST) -> float:
    """A number of a description. Raises DataSetError with the value and what was expected."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        wanted = "a number" if (least, most) == (-LARGEST, LARGEST) else f"a number from {least:g} to {most:g}"
        raise DataSetError(f"{place}: meta.{name} = {value!r}, expected {wanted}; correct the description")
    return float(value)


def check_laser(path: Path, arrays: Arrays, meta: Mapping[str, Any]) -> None:
    """Raises DataSetError where nothing says how the laser looks: its description, or three numbers for each scan."""
    beams = arrays["ranges"].shape[1]
    if beams == 0:
        raise DataSetError(f"{path}: ranges has no column; a scan must have at least one beam")
    own = [name for name in BEAMS if name in arrays]
    if own and len(own) < len(BEAMS):
        raise DataSetError(f"{path} has {own[0]} without the other two of {', '.join(BEAMS)}; give all or none")
    if own and not ((arrays["scan_beams"] >= 1) & (arrays["scan_beams"] <= beams)).all():
        raise DataSetError(f"{path}: scan_beams is not within 1 and {beams}, the columns of ranges, everywhere")
    for name in ("range_max",) if own else ("angle_min", "angle_increment", "range_max"):
        if name not in meta:
            raise DataSetError(f"{path}: meta lacks {name}; it must describe the sensor (format ld2d-1)")
        number(path, name, meta[name], *WITHIN[name])
    for name in ("range_min", "time_increment"):
        number(path, name, meta.get(name, 0.0), *WITHIN[name])
    spans = [meta["angle_increment"] * (beams - 1)] if not own else arrays[BEAMS[1]] * (arrays["scan_beams"] - 1)
    for span_rad in np.unique(np.abs(spans)).tolist():
        if span_rad >= LARGEST_SPAN_RAD or (span_rad == 0.0 and beams > 1 and not own):
            raise DataSetError(
                f"{path}: meta.angle_increment with {beams} beams spans {math.degrees(span_rad):.0f} deg; expected "
                "radians from one beam to the next"
            )


def _check_form(path: Path, name: str, array: NDArray[Any], columns: Columns) -> None:
    if array.dtype.kind not in "biuf":
        raise DataSetError(f"{path}: {name} holds {array.dtype}, expected numbers")
    fits = array.ndim == 1 + len(columns)
    if not fits or any(want not in (ANY, have) for want, have in zip(columns, array.shape[1:], strict=True)):
        wanted = "".join(", beams" if column == ANY else f", {column}" for column in columns) or ","
        raise DataSetError(f"{path}: {name} has the shape {array.shape}, expected (rows{wanted})")


def _usable(path: Path, what: str, first: str, group: Arrays, left_out: LeftOut) -> BoolArray:
    """Which rows of a group can be used; the others are counted with the first of them."""
    rows = np.ones(len(group[first]), bool)
    if first.endswith("_t"):
        times_s = group[first].astype(np.float64)
        timely = np.abs(times_s) < LATEST_S
        if not timely.any() and rows.size:
            raise DataSetError(f"{path}: {first}[0] = {times_s[0]:g}, expected seconds; nothing was written")
        _leave_out(rows, timely, what, f"{first} is not a time in seconds", first, left_out)
        if rows.any():
            near = np.abs(times_s - np.median(times_s[rows])) < FARTHEST_S
            _leave_out(rows, near, what, f"{first} is a month or more from the others", first, left_out)
    for name, array in group.items():
        if name not in MAY_BE_NAN and not name.endswith("_t"):
            fits = np.abs(array) < LARGEST  # false for NaN
            finite = np.asarray(fits if array.ndim == 1 else fits.all(axis=1), bool)
            _leave_out(rows, finite, what, f"{name} is not a finite number", name, left_out)
    if first in ("scan_t", "odom_t", "gt_t"):
        times_s[~rows] = np.nan
        rising = longest_rising(times_s.round(9))
        _leave_out(rows, rising, what, f"{first} does not increase there", first, left_out)
    return rows


def _leave_out(rows: BoolArray, good: BoolArray, what: str, reason: str, name: str, left_out: LeftOut) -> None:
    """Take the rows that are not good out of those in use."""
    bad = np.flatnonzero(rows & ~good)
    if bad.size:
        left_out.add(what, reason, f"{name}[{bad[0]}]", bad.size)
        rows &= good
