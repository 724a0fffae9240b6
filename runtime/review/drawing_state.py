"""What a drawing process knows of the run so far, how it is handed to the one that goes on, and what it says of it."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np
import rerun as rr

from drivers.measurements import FloatArray
from runtime.messages.estimate import decode_estimate, encode_estimate
from runtime.review.clock_offset import ClockState, LaserClockOffset
from runtime.review.columns import ReviewColumns
from runtime.review.layout import MOVED, TRUTH, Color, Extent, grid_spacing_m
from slam.estimate import Estimate, LandmarkMap
from slam.pose import Pose2

ENDS: dict[str, Color] = {"start": TRUTH, "end": MOVED}
LARGE = 7.0  # points of the screen
BESIDE = 0.08  # of the height of the view over the whole map: as wide as the names are
SHOWN = ("run", "created", "verdict")


@dataclass(slots=True)
class DrawingState:
    """start_ns: stamp of the first tick; drawn: ticks so far; last_drawn: of them, when each kind of thing was drawn.

    before: the last estimate; landmarks: the last map; path_ends_m: where each path was left off, (1, 2) each.
    start_m: where the path begins; driven_m: way so far; squared_error_m2: sum of as many as `errors`, against the
    simulator's truth.
    """

    extent: Extent = field(default_factory=Extent)
    with_truth: bool = False
    start_ns: int | None = None
    drawn: int = 0
    last_drawn: dict[str, int] = field(default_factory=dict)
    path_ends_m: dict[str, FloatArray] = field(default_factory=dict)
    clock: LaserClockOffset = field(default_factory=LaserClockOffset)
    before: Estimate | None = None
    landmarks: LandmarkMap | None = None
    driven_m: float = 0.0
    squared_error_m2: float = 0.0
    errors: int = 0
    start_m: tuple[float, float] = (0.0, 0.0)

    def measure(self, now: Estimate, truth: Pose2 | None) -> None:
        """Add up the way since the estimate before, by dead reckoning, and the square of the error."""
        if self.before is not None:
            step = self.before.odom_from_body.inverse() @ now.odom_from_body
            self.driven_m += math.hypot(step.x_m, step.y_m)
        if truth is not None:
            pose = now.map_from_body
            self.squared_error_m2 += (pose.x_m - truth.x_m) ** 2 + (pose.y_m - truth.y_m) ** 2
            self.errors += 1

    def to_bytes(self) -> bytes:
        """A line of JSON, then the last estimate as its record holds it, with the last map in it."""
        values = {
            "extent": asdict(self.extent),
            "with_truth": self.with_truth,
            "start_ns": self.start_ns,
            "drawn": self.drawn,
            "last_drawn": self.last_drawn,
            "path_ends_m": {name: end_m.tolist() for name, end_m in self.path_ends_m.items()},
            "driven_m": self.driven_m,
            "squared_error_m2": self.squared_error_m2,
            "errors": self.errors,
            "start_m": self.start_m,
            "clock": None if self.clock.state is None else asdict(self.clock.state),
        }
        estimate = b""
        if self.before is not None:
            estimate = encode_estimate(replace(self.before, landmarks=self.landmarks)).data
        return json.dumps(values).encode() + b"\n" + estimate

    @classmethod
    def from_bytes(cls, data: bytes) -> "DrawingState":
        """Back again."""
        line, _, estimate = data.partition(b"\n")
        values = json.loads(line)
        clock, before = values["clock"], decode_estimate(estimate) if estimate else None
        return cls(
            Extent(**values["extent"]),
            values["with_truth"],
            values["start_ns"],
            values["drawn"],
            values["last_drawn"],
            {name: np.array(end_m) for name, end_m in values["path_ends_m"].items()},
            LaserClockOffset(None if clock is None else ClockState(**clock)),
            before,
            None if before is None else before.landmarks,
            values["driven_m"],
            values["squared_error_m2"],
            values["errors"],
            tuple(values["start_m"]),
        )


def draw_start(columns: ReviewColumns, state: DrawingState, pose: Pose2) -> None:
    """A large point with its name."""
    state.start_m = pose.x_m, pose.y_m
    _draw_named(columns, "start", state.start_m, "start")


def draw_end(columns: ReviewColumns, state: DrawingState, pose: Pose2) -> None:
    """The same for the end; where it lies at the start, one point with both names, which would hide each other."""
    word, (x_m, y_m) = "end", state.start_m
    if math.hypot(pose.x_m - x_m, pose.y_m - y_m) < BESIDE * state.extent.eye_height_m:
        word = "start and end"
        columns.named_points("map/start", np.empty((0, 2)), np.empty((0, 3), np.uint8), [])
    _draw_named(columns, "end", (pose.x_m, pose.y_m), word)


def _draw_named(columns: ReviewColumns, name: str, place_m: tuple[float, float], word: str) -> None:
    columns.named_points(f"map/{name}", np.array((place_m,)), np.array((ENDS[name],), np.uint8), [word])


def first_place(path_m: Sequence[tuple[float, float]], pose: Pose2) -> Pose2:
    """Where the path begins that a late viewer was told of, else the first pose that is drawn."""
    return Pose2(*path_m[0]) if path_m else pose


def draw_end_styles(recording: rr.RecordingStream) -> None:
    """Said once in a file."""
    for name in ENDS:
        style = rr.Points3D.from_fields(radii=rr.Radius.ui_points(LARGE), show_labels=True)
        recording.log(f"map/{name}", style, static=True)
    marks = rr.SeriesPoints(colors=[(255, 215, 80)], markers="diamond", names="mark", marker_sizes=6.0)
    recording.log("plots/error/mark", marks, static=True)


def caption(state: DrawingState, facts: Mapping[str, str]) -> str:
    """One line for above the map: run, UTC, verdict, distance, error where there is a truth, size of a square."""
    parts = [facts[name] for name in SHOWN if facts.get(name)]
    if state.driven_m:
        parts.append(f"{state.driven_m:.0f} m driven")
    if state.errors:
        parts.append(f"error {(state.squared_error_m2 / state.errors) ** 0.5:.3f} m RMS")
    parts.append(f"a square is {grid_spacing_m(state.extent.eye_height_m):g} m")
    return " | ".join(parts)
