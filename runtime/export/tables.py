"""The published path for programs that read lines: CSV for a spreadsheet, TUM for evo, GeoJSON for a map viewer."""

import json
import math
from pathlib import Path

import numpy as np

from runtime.map_files.origin import MapOrigin
from runtime.maps.geodetic import coordinates_note, placed
from runtime.maps.landmark_files import landmark_geojson
from runtime.messages.recorded_tick import RecordedTick
from slam.estimate import Estimate, LandmarkMap

COLUMNS = (
    "stamp_s,x_m,y_m,heading_rad,sigma_x_m,sigma_y_m,sigma_heading_rad,quality,landmarks,"
    "odom_x_m,odom_y_m,odom_heading_rad,truth_x_m,truth_y_m,truth_heading_rad"
)
SPACING_M = 0.05  # of the points of the line in GeoJSON


class _Lines:
    """A new text file."""

    def __init__(self, path: Path, offset_ns: int) -> None:
        self._offset_ns = offset_ns
        self._file = path.open("x", encoding="utf-8")

    def _stamp(self, stamp_ns: int) -> str:
        """Seconds with all nine digits, which a float would lose."""
        seconds, nanoseconds = divmod(stamp_ns + self._offset_ns, 1_000_000_000)
        return f"{seconds}.{nanoseconds:09d}"

    def finish(self) -> None:
        """Nothing is left to write."""
        self._file.flush()

    def close(self) -> None:
        """Give the file back."""
        self._file.close()


class CsvFile(_Lines):
    """One line for each tick; the columns of the truth are empty where there is none."""

    def __init__(self, path: Path, offset_ns: int) -> None:
        super().__init__(path, offset_ns)
        self._file.write(COLUMNS + "\n")

    def add(self, recorded: RecordedTick, estimate: Estimate) -> None:
        """A tick."""
        pose, dead, truth = estimate.map_from_body, estimate.odom_from_body, recorded.truth
        sigmas = [math.sqrt(max(0.0, float(estimate.covariance[axis, axis]))) for axis in range(3)]
        cells = [
            self._stamp(estimate.stamp_ns),
            *(f"{value:.6f}" for value in (pose.x_m, pose.y_m, pose.heading_rad, *sigmas)),
            estimate.quality.value,
            str(int(estimate.counts.get("landmarks", 0))),
            *(f"{value:.6f}" for value in (dead.x_m, dead.y_m, dead.heading_rad)),
            *(("",) * 3 if truth is None else (f"{value:.6f}" for value in truth.as_array().tolist())),
        ]
        self._file.write(",".join(cells) + "\n")


class TumFile(_Lines):
    """Lines of stamp, position and quaternion, as evo reads them."""

    def add(self, _recorded: RecordedTick, estimate: Estimate) -> None:
        """A tick."""
        pose = estimate.map_from_body
        z, w = math.sin(0.5 * pose.heading_rad), math.cos(0.5 * pose.heading_rad)
        self._file.write(f"{self._stamp(estimate.stamp_ns)} {pose.x_m:.6f} {pose.y_m:.6f} 0 0 0 {z:.9f} {w:.9f}\n")


class GeoJsonFile(_Lines):
    """The path as a line and the last landmarks as points, in degrees where the origin is known, else in metres."""

    def __init__(self, path: Path, offset_ns: int, origin: MapOrigin | None) -> None:
        super().__init__(path, offset_ns)
        self._origin = origin
        self._line: list[list[float]] = []
        self._stamps: list[str] = []
        self._landmarks: LandmarkMap | None = None

    def add(self, _recorded: RecordedTick, estimate: Estimate) -> None:
        """A tick; of a rover that hardly moved one point counts."""
        at = [round(estimate.map_from_body.x_m, 3), round(estimate.map_from_body.y_m, 3)]
        if not self._line or math.dist(at, self._line[-1]) >= SPACING_M:
            self._line.append(at)
            self._stamps.append(self._stamp(estimate.stamp_ns))
        self._landmarks = estimate.landmarks or self._landmarks

    def finish(self) -> None:
        """Write it all."""
        origin = self._origin
        points = [] if self._landmarks is None else json.loads(landmark_geojson(self._landmarks, origin))["features"]
        line_m = self._line if len(self._line) > 1 else self._line * 2  # a line has two points at least
        whole = placed(origin, np.array(line_m))
        line = {
            "type": "Feature",
            "geometry": {"type": "LineString", "coordinates": whole},
            "properties": {"name": "path", "begins_s": self._stamps[0], "ends_s": self._stamps[-1]},
        }
        collection = {"type": "FeatureCollection", **coordinates_note(origin), "features": [line, *points]}
        json.dump(collection, self._file, allow_nan=False)
        super().finish()
