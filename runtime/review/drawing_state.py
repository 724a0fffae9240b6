"""What a drawing process knows of the run so far, and how it is handed to the one that goes on in its place."""

import json
import math
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from drivers.measurements import FloatArray
from runtime.messages.estimate import decode_estimate, encode_estimate
from runtime.review.clock_offset import ClockState, LaserClockOffset
from runtime.review.layout import Extent
from slam.estimate import Estimate, LandmarkMap
from slam.pose import Pose2


@dataclass(slots=True)
class DrawingState:
    """start_ns: stamp of the first tick; drawn: ticks so far; last_drawn: of them, when each kind of thing was drawn.

    before: the last estimate; landmarks: the last map; path_ends_m: where each path was left off, (1, 2) each.
    driven_m: way so far; squared_error_m2: sum of as many as `errors`, against the simulator's truth.
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
        )
