"""How review.rrd looks: what is drawn in which colour, and which view stands where."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from drivers.measurements import FloatArray
from runtime.review.curves import curve_views
from runtime.review.ticks import ELAPSED, TICK
from slam.observations import MatchVerdict
from slam.pose import Pose2

Color = tuple[int, int, int]

SLAM: Color = (80, 170, 255)
ODOMETRY: Color = (255, 160, 60)
TRUTH: Color = (95, 225, 120)
KEPT: Color = (205, 215, 225)
MOVED: Color = (255, 75, 75)
NOT_COMPARED: Color = (115, 118, 130)
TRACE: Color = (88, 96, 112)
SPOKES: Color = (60, 140, 80)
PARTICLES: Color = (225, 120, 255)
SURE: Color = (255, 215, 80)
DOUBTED: Color = (130, 70, 60)
NEW: Color = (90, 255, 220)

VERDICTS: dict[int, tuple[str, Color]] = {
    MatchVerdict.NEW: ("new", NEW),
    MatchVerdict.UNLICENSED: ("difference", (255, 130, 100)),
    MatchVerdict.AMBIGUOUS: ("density", (255, 90, 170)),
    MatchVerdict.EXCLUDED: ("exclusivity", (255, 90, 90)),
    MatchVerdict.OUT_OF_RANGE: ("range", (150, 150, 165)),
}
"""Label and colour of a feature that was not matched: new, or the technique that refused it."""

CURVES: dict[str, Color] = {
    "plots/error/SLAM_m": SLAM,
    "plots/error/odometry_m": ODOMETRY,
    "plots/error/2_sigma_m": (150, 150, 165),
    "plots/timing/lateness_ms": (255, 215, 80),
    "plots/timing/step_ms": SLAM,
    "plots/timing/read_ms": (150, 150, 165),
    "plots/filter/effective_particles": PARTICLES,
    "plots/map/landmarks": SURE,
    "plots/map/created": TRUTH,
    "plots/map/removed": MOVED,
    "plots/innovation_range_m/mean": SLAM,
    "plots/innovation_range_m/RMS": (150, 150, 165),
    "plots/innovation_bearing_deg/mean": SLAM,
    "plots/innovation_bearing_deg/RMS": (150, 150, 165),
    "plots/clock/laser_ms": KEPT,
    "plots/filter/features": (150, 150, 165),
    "plots/filter/matched": TRUTH,
    "plots/motion/speed_mps": SLAM,
    "plots/sensors/laser_age_ms": KEPT,
    "plots/sensors/wheels_age_ms": ODOMETRY,
}

ROVER_HEIGHT_M = 0.25  # over all else
AROUND_M = 14.0  # from where the view around the rover shows some 8 m ahead and behind
FAR_M = 2.0 * AROUND_M  # the same for the laser's frame
NEAR_NAMES, FAR_NAMES = "map/association/names", "map/association/names_far"
NAMES: dict[str, tuple[float, float]] = {
    path: (0.24 * height, 0.07 * height) for path, height in ((NEAR_NAMES, AROUND_M), (FAR_NAMES, FAR_M))
}
"""Where the names of features stand, and how wide and high a name is, in m, seen from the height of the view."""

LEGEND = """\
# How to read this run

| colour | what |
|---|---|
| blue line | SLAM: the published pose |
| orange line | odometry alone |
| green line or points | truth, where it is known; for a data set: fitted to the map by the best rigid motion |
| white points | laser, kept |
| red points | laser, rejected: moved between scans |
| grey points | laser, nothing to compare with |
| dark grey points | laser, kept, once a second until now: walls that stay thin mean that the map holds |
| violet points | particles |
| yellow points | landmarks; brown if their existence is doubted |
| discs | covariances, {sigmas:g} sigma |
| green spokes | a feature matched to its landmark |
| curves of age | laser white, wheels orange |
| curves of innovation | seen minus expected, of ranges and bearings: mean blue, RMS grey |
| curve of the laser's clock | host minus laser since the start: a slope is drift, 1 ms in 10 s is 100 ppm |
| labelled points | a feature that is new, or the technique that refused it; "x 3": so many next to each other |

{facts}
"""


@dataclass(frozen=True, slots=True)
class Extent:
    """What the map view must show: a box in the map frame, in metres."""

    low_x_m: float = -10.0
    low_y_m: float = -10.0
    high_x_m: float = 10.0
    high_y_m: float = 10.0

    def with_points(self, points_m: FloatArray) -> "Extent":
        """The box that also holds these (N, 2)."""
        if not len(points_m):
            return self
        (low_x_m, low_y_m), (high_x_m, high_y_m) = points_m.min(axis=0).tolist(), points_m.max(axis=0).tolist()
        return replace(
            self,
            low_x_m=min(self.low_x_m, low_x_m),
            low_y_m=min(self.low_y_m, low_y_m),
            high_x_m=max(self.high_x_m, high_x_m),
            high_y_m=max(self.high_y_m, high_y_m),
        )

    @property
    def center_m(self) -> tuple[float, float]:
        """Middle of the box."""
        return 0.5 * (self.low_x_m + self.high_x_m), 0.5 * (self.low_y_m + self.high_y_m)

    @property
    def eye_height_m(self) -> float:
        """From where a view a little wider than high shows the whole box; the viewer opens 55 degrees."""
        return 1.08 * max(self.high_y_m - self.low_y_m, (self.high_x_m - self.low_x_m) / 1.05, 5.0)


def draw_static(recording: rr.RecordingStream, body_from_laser: Pose2) -> None:
    """Styles, the rover's shape and where the laser stands on it: said once."""
    recording.log("map", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for path, color, size in (
        ("map/laser/kept", KEPT, 1.3),
        ("map/laser/rejected", MOVED, 2.0),
        ("map/laser/not_compared", NOT_COMPARED, 1.1),
        ("map/laser/trace", TRACE, 0.9),
        ("map/particles", PARTICLES, 2.0),
    ):
        style = rr.Points3D.from_fields(colors=[color], radii=rr.Radius.ui_points(size))
        recording.log(path, style, static=True)
    for path, color, size in (
        ("map/path/odometry", ODOMETRY, 1.0),
        ("map/path/truth", TRUTH, 1.0),
        ("map/path/SLAM", SLAM, 1.4),
        ("map/association/matched", SPOKES, 0.6),
    ):
        line = rr.LineStrips3D.from_fields(colors=[color], radii=rr.Radius.ui_points(size))
        recording.log(path, line, static=True)
    for path in ("map/association/new_and_refused", "map/landmarks"):
        style = rr.Points3D.from_fields(radii=rr.Radius.ui_points(3.0), show_labels=False)
        recording.log(path, style, static=True)
    for path in NAMES:
        recording.log(path, rr.Points3D.from_fields(radii=rr.Radius.ui_points(0.1), show_labels=True), static=True)
    for path, colors in (("map/landmarks/covariances", None), ("map/pose_covariance", [(*SLAM, 70)])):
        disc = rr.Ellipsoids3D.from_fields(fill_mode="solid", colors=colors)
        recording.log(path, disc, static=True)
    draw_rover(recording, "map/rover", SLAM)
    draw_laser(recording, "map/rover/laser", body_from_laser)
    for path, color in CURVES.items():
        curve = rr.SeriesLines(colors=[color], names=path.rsplit("/", 1)[1].replace("_", " "), widths=1.5)
        recording.log(path, curve, static=True)


def draw_legend(recording: rr.RecordingStream, facts: dict[str, str], sigmas: float) -> None:
    """What the colours mean, and the facts of the run; a later one takes the place of an earlier one."""
    table = "\n".join(f"- {name}: `{value}`" for name, value in facts.items())
    legend = rr.TextDocument(LEGEND.format(facts=table, sigmas=sigmas), media_type="text/markdown")
    recording.log("legend", legend, static=True)


def draw_rover(recording: rr.RecordingStream, path: str, color: Color) -> None:
    """An outline of 0.7 m by 0.5 m with a nose, and an arrow ahead that is seen from far."""
    corners_m = ((-0.35, -0.25), (0.2, -0.25), (0.35, 0.0), (0.2, 0.25), (-0.35, 0.25), (-0.35, -0.25))
    strips_m = [[(x, y, ROVER_HEIGHT_M) for x, y in strip] for strip in (corners_m, ((0.0, 0.0), (1.2, 0.0)))]
    shape = rr.LineStrips3D(strips_m, colors=[color], radii=rr.Radius.ui_points(1.6))
    recording.log(f"{path}/shape", shape, static=True)


def draw_laser(recording: rr.RecordingStream, path: str, body_from_laser: Pose2) -> None:
    """The laser's frame on the rover: x ahead red, y left green, 0.3 m each."""
    half_rad = 0.5 * body_from_laser.heading_rad
    quaternion = rr.Quaternion(xyzw=(0.0, 0.0, math.sin(half_rad), math.cos(half_rad)))
    place_m = (body_from_laser.x_m, body_from_laser.y_m, 0.0)
    recording.log(path, rr.Transform3D(translation=place_m, quaternion=quaternion), static=True)
    origin, height = (0.0, 0.0, ROVER_HEIGHT_M), ROVER_HEIGHT_M
    axes = rr.LineStrips3D(
        [[origin, (0.3, 0.0, height)], [origin, (0.0, 0.3, height)]],
        colors=[(255, 75, 75), (95, 225, 120)],
        radii=rr.Radius.ui_points(1.2),
    )
    recording.log(f"{path}/axes", axes, static=True)


def draw_set_truth(recording: rr.RecordingStream, landmarks_m: FloatArray) -> None:
    """Style of a data set's true places, and where landmarks (n, 2) really stand in the map frame, if it knows."""
    style = rr.Points3D.from_fields(colors=[TRUTH], radii=rr.Radius.ui_points(2.0))
    recording.log("map/truth_places", style, static=True)
    if len(landmarks_m):
        places_m = np.column_stack((landmarks_m, np.full(len(landmarks_m), 0.1)))
        rings = rr.Points3D(places_m, colors=[TRUTH], radii=rr.Radius.ui_points(4.0))
        recording.log("map/truth_landmarks", rings, static=True)


def layout(extent: Extent, with_truth: bool, caption: str = "map from above", is_live: bool = False) -> rrb.Blueprint:
    """Map from above with its caption, surroundings in the rover's and the laser's frame, plots, events, legend.

    is_live: without the plots of what a rover that drives does not tell.
    """
    x_m, y_m = extent.center_m
    whole = rrb.Spatial3DView(
        name=caption,
        origin="map",
        contents=["map/**", "- map/association/**"],
        eye_controls=_from_above((x_m, y_m, 0.0), extent.eye_height_m),
        line_grid=_grid(extent.eye_height_m),
        background=(14, 16, 20),
        overrides=_whole_paths(),
    )
    around = rrb.Spatial3DView(
        name="around the rover: what became of each feature",
        origin="map/rover",
        contents=["map/**", f"- {FAR_NAMES}"],
        eye_controls=_from_above((0.0, 0.0, 0.0), AROUND_M),
        line_grid=_grid(AROUND_M),
        background=(14, 16, 20),
        overrides=_whole_paths(),
    )
    laser = rrb.Spatial3DView(
        name="laser frame",
        origin="map/rover/laser",
        contents=["map/laser/**", "- map/laser/trace", "map/rover/laser/**", "map/association/**", f"- {NEAR_NAMES}"],
        eye_controls=_from_above((0.0, 0.0, 0.0), FAR_M),
        line_grid=_grid(AROUND_M),
        background=(14, 16, 20),
    )
    near = rrb.Tabs(around, laser)
    plots = curve_views(with_truth, is_live)
    words = rrb.Tabs(
        rrb.TextLogView(name="events", origin="events", columns=_event_columns()),
        rrb.TextDocumentView(name="legend", origin="legend"),
    )
    return rrb.Blueprint(
        rrb.Horizontal(whole, rrb.Vertical(near, plots, words, row_shares=[9, 9, 4]), column_shares=[11, 9]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=ELAPSED),
        auto_views=False,
    )


def _from_above(target_m: tuple[float, float, float], height_m: float) -> Any:
    """North up, east right: rerun's 2D views would mirror the map, their y axis points down."""
    x_m, y_m, _ = target_m
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital, position=(x_m, y_m, height_m), look_target=target_m, eye_up=(0.0, 1.0, 0.0)
    )


def grid_spacing_m(height_m: float) -> float:
    """Side of a square of the grid, seen from this height."""
    return 1.0 if height_m < 40.0 else 10.0 if height_m < 400.0 else 100.0


def _grid(height_m: float) -> Any:
    spacing_m = grid_spacing_m(height_m)
    return rrb.LineGrid3D(visible=True, spacing=spacing_m, stroke_width=0.5, color=(60, 64, 74, 110))


def _whole_paths() -> Any:
    """Paths are logged in pieces of a second; all pieces up to the cursor are the path."""
    start, end = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()
    until_now = rrb.VisibleTimeRanges(
        [rrb.VisibleTimeRange(timeline=timeline, start=start, end=end) for timeline in (ELAPSED, TICK)]
    )
    pieces = ("map/path/SLAM", "map/path/odometry", "map/path/truth", "map/laser/trace", "map/truth_places")
    return dict.fromkeys(pieces, until_now)


def _event_columns() -> Any:
    kinds = rrb.encodings.TextLogColumnKind
    return rrb.TextLogColumns(text_log_columns=[kinds.LogLevel, kinds.Body])
