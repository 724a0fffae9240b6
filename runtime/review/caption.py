"""What is written into the picture: which run it is, how far it drove and how well, and where it began and ended."""

from collections.abc import Mapping

import numpy as np
import rerun as rr

from runtime.review.columns import ReviewColumns
from runtime.review.drawing_state import DrawingState
from runtime.review.layout import MOVED, TRUTH, Color, grid_spacing_m
from slam.pose import Pose2

ENDS: dict[str, Color] = {"start": TRUTH, "end": MOVED}
LARGE = 7.0  # points of the screen
SHOWN = ("run", "created", "verdict")


def draw_end(columns: ReviewColumns, name: str, pose: Pose2) -> None:
    """A large point with its name, "start" or "end"."""
    color = np.array((ENDS[name],), np.uint8)
    columns.named_points(f"map/{name}", np.array(((pose.x_m, pose.y_m),)), color, [name])


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
        parts.append(f"error {(state.squared_error_m2 / state.errors) ** 0.5:.2f} m RMS")
    parts.append(f"a square is {grid_spacing_m(state.extent.eye_height_m):g} m")
    return " | ".join(parts)
