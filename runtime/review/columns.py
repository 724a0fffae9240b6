"""Rows of a few seconds gathered per entity and sent to rerun as columns: a third of the cost of row by row.

What rows are gathered from is kept as it comes; it is turned into what rerun wants all at once, in `flush`.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from drivers.measurements import FloatArray
from runtime.review.ticks import ELAPSED, TICK
from slam.observations import BeamVerdict
from slam.pose import Pose2

GRAIN_M = 1.0 / 256.0  # 4 mm: far below what a picture shows, and the zero bits that are left compress
SIGMAS = 2.0  # half axes of covariance ellipses, in standard deviations


LASER_PATHS = {
    BeamVerdict.KEPT: "map/laser/kept",
    BeamVerdict.MOVED: "map/laser/rejected",
    BeamVerdict.NOT_COMPARED: "map/laser/not_compared",
}
HEIGHTS_M = {"map/path/odometry": 0.02, "map/path/truth": 0.05, "map/path/SLAM": 0.08}
HEIGHTS_M |= {"map/landmarks": 0.1, "map/association": 0.15, "map/particles": 0.2}
"""What lies over what when seen from above; all else lies at 0."""


class ReviewColumns:
    """Gathers rows and sends them with `flush`; rows of one entity must all be of one kind."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._elapsed_ns = 0
        self._tick = 0
        self._rows: dict[str, list[tuple[int, int, Any]]] = {}
        self._kinds: dict[str, str] = {}
        self._scans: list[tuple[int, int, FloatArray, NDArray[np.uint8]]] = []

    def at(self, elapsed_ns: int, tick: int) -> None:
        """Time of the rows that follow."""
        self._elapsed_ns, self._tick = elapsed_ns, tick

    def scalar(self, path: str, value: float) -> None:
        """One value of a curve."""
        self._add(path, "scalar", value)

    def points(self, path: str, points_m: FloatArray) -> None:
        """Points (N, 2) in the map; style is static."""
        self._add(path, "points", points_m)

    def scan(self, points_m: FloatArray, verdicts: NDArray[np.uint8]) -> None:
        """Points (N, 2) in the map, each below the path of its verdict (N,)."""
        self._scans.append((self._elapsed_ns, self._tick, points_m, verdicts))

    def named_points(self, path: str, points_m: FloatArray, colors: NDArray[np.uint8], labels: list[str]) -> None:
        """Points (N, 2) with a colour (N, 3) and a label each."""
        self._add(path, "named points", (points_m, colors, labels))

    def strip(self, path: str, strip_m: FloatArray) -> None:
        """A line (K, 2)."""
        self._add(path, "strip", strip_m)

    def strips(self, path: str, strips_m: FloatArray) -> None:
        """Lines (N, K, 2), of K points each."""
        self._add(path, "strips", strips_m)

    def ellipses(self, path: str, means_m: FloatArray, covariances_m2: FloatArray, colors: Any) -> None:
        """Covariance ellipses of (N, 2, 2) around (N, 2); colors (N, 4), or None where the style is static."""
        self._add(path, "ellipses", (means_m, covariances_m2, colors))

    def pose(self, path: str, pose: Pose2) -> None:
        """Frame of what is drawn below this path."""
        self._add(path, "pose", pose)

    def text(self, path: str, text: str, level: str, elapsed_ns: int) -> None:
        """One line of a log, at its own time."""
        self._rows.setdefault(path, []).append((elapsed_ns, self._tick, (text, level)))
        self._kinds[path] = "text"

    def flush(self) -> None:
        """Send what has been gathered."""
        for path, rows in self._rows.items():
            columns = _columns(self._kinds[path], [row[2] for row in rows], height_m(path))
            self._recording.send_columns(path, _indexes(rows), columns)
        self._rows.clear()
        if self._scans:
            self._send_scans()

    def _send_scans(self) -> None:
        indexes, rows = _indexes(self._scans), np.arange(len(self._scans))
        positions = flat(np.concatenate([scan[2] for scan in self._scans]))
        verdicts = np.concatenate([scan[3] for scan in self._scans])
        row_of = np.repeat(rows, [len(scan[3]) for scan in self._scans])
        for verdict, path in LASER_PATHS.items():
            chosen = verdicts == verdict
            lengths = np.bincount(row_of[chosen], minlength=rows.size)
            points = rr.Points3D.columns(positions=positions[chosen]).partition(lengths)
            self._recording.send_columns(path, indexes, points)
        self._scans.clear()

    def _add(self, path: str, kind: str, row: Any) -> None:
        self._kinds[path] = kind
        self._rows.setdefault(path, []).append((self._elapsed_ns, self._tick, row))


def height_m(path: str) -> float:
    """Height at which an entity is drawn."""
    return next((height for start, height in HEIGHTS_M.items() if path.startswith(start)), 0.0)


def flat(points_m: FloatArray, height: float = 0.0) -> NDArray[np.float32]:
    """Points (..., 2) as (..., 3) at one height, on a grid of GRAIN_M."""
    positions = np.full((*points_m.shape[:-1], 3), height, np.float32)
    positions[..., :2] = np.round(points_m / GRAIN_M) * GRAIN_M
    return positions


def ellipse_axes(covariances_m2: FloatArray, sigmas: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Half sizes (N, 3) and quaternions (N, 4) xyzw of flat ellipsoids for covariances (N, 2, 2)."""
    values, vectors = np.linalg.eigh(covariances_m2)
    half_sizes = np.full((len(values), 3), 0.005, np.float32)
    half_sizes[:, :2] = sigmas * np.sqrt(values.clip(min=1e-8))
    half_turns_rad = 0.5 * np.arctan2(vectors[:, 1, 0], vectors[:, 0, 0])
    quaternions = np.zeros((len(values), 4), np.float32)
    quaternions[:, 2], quaternions[:, 3] = np.sin(half_turns_rad), np.cos(half_turns_rad)
    return half_sizes, quaternions


def _indexes(rows: Sequence[tuple[Any, ...]]) -> list[rr.TimeColumn]:
    """Both times of rows that begin with them."""
    elapsed_ns = np.array([row[0] for row in rows]).astype("timedelta64[ns]")
    return [rr.TimeColumn(ELAPSED, duration=elapsed_ns), rr.TimeColumn(TICK, sequence=[row[1] for row in rows])]


def _columns(kind: str, rows: list[Any], height: float) -> Any:
    match kind:
        case "scalar":
            return rr.Scalars.columns(scalars=rows)
        case "points":
            lengths = [len(row) for row in rows]
            return rr.Points3D.columns(positions=flat(np.concatenate(rows), height)).partition(lengths)
        case "named points":
            lengths = [len(row[0]) for row in rows]
            return rr.Points3D.columns(
                positions=flat(np.concatenate([row[0] for row in rows]), height),
                colors=np.concatenate([row[1] for row in rows]),
                labels=[label for row in rows for label in row[2]],
            ).partition(lengths)
        case "strip":
            return rr.LineStrips3D.columns(strips=[flat(row, height) for row in rows])
        case "strips":
            lengths = [len(row) for row in rows]
            return rr.LineStrips3D.columns(strips=flat(np.concatenate(rows), height)).partition(lengths)
        case "ellipses":
            return _ellipse_columns(rows, height)
        case "pose":
            headings_rad = np.array([pose.heading_rad for pose in rows])
            quaternions = np.zeros((len(rows), 4))
            quaternions[:, 2], quaternions[:, 3] = np.sin(0.5 * headings_rad), np.cos(0.5 * headings_rad)
            return rr.Transform3D.columns(
                translation=[(pose.x_m, pose.y_m, 0.0) for pose in rows], quaternion=quaternions
            )
        case "text":
            return rr.TextLog.columns(text=[row[0] for row in rows], level=[row[1] for row in rows])
    raise ValueError(f"{kind=} is not a kind of row")


def _ellipse_columns(rows: list[Any], height: float) -> Any:
    lengths = [len(row[0]) for row in rows]
    centers = flat(np.concatenate([row[0] for row in rows]), height)
    half_sizes, quaternions = ellipse_axes(np.concatenate([row[1] for row in rows]), SIGMAS)
    fields: dict[str, Any] = {"centers": centers, "half_sizes": half_sizes, "quaternions": quaternions}
    if rows[0][2] is not None:
        fields["colors"] = np.concatenate([row[2] for row in rows])
    return rr.Ellipsoids3D.columns(**fields).partition(lengths)


def mixed(low: tuple[int, int, int], high: tuple[int, int, int], share: FloatArray) -> NDArray[np.uint8]:
    """Colours (N, 3) between two, by shares (N,) in 0 to 1."""
    colors = np.outer(1.0 - share, low) + np.outer(share, high)
    return colors.round().astype(np.uint8)
