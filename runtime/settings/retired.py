"""Keys that configurations once had: where their numbers are now, and how the configuration of an old run is read.

In a file such a key is refused with the place of its number; in a recorded header it is translated or passed over, so
that every run that was ever recorded still replays.
"""

import tomllib
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from drivers.settings.vehicle import JUMP_FACTOR
from runtime.settings.not_keys import INTERNAL
from runtime.settings.trees import MISSING, Tree, copy_of, put, take, value_at

DELIVERED = ("config/infant.dbc", "config/encoder406.eds")


class Moved(NamedTuple):
    """A key under another name: the keys that took its place, and the value that they get for an old one.

    entered_replays: whether a replay depended on it; the driver's own copies of the geometry did not.
    """

    keys: tuple[str, ...]
    value: Callable[[Any], Any] = lambda value: value
    entered_replays: bool = True


GEOMETRY = (
    "wheel_radius_left_m",
    "wheel_radius_right_m",
    "tread_m",
    "counts_per_rev",
    "wheel_base_m",
    "speed_wheel_offset_m",
    "steering_scale",
    "steering_bias_rad",
)
MOVED: dict[str, Moved] = {
    **{f"slam.odometry.{name}": Moved((f"vehicle.{name}",)) for name in GEOMETRY},
    "slam.odometry.model": Moved(("vehicle.motion_model",)),
    "slam.odometry.max_speed_mps": Moved(("vehicle.max_speed_mps",), lambda jump_mps: jump_mps / JUMP_FACTOR),
    "encoders.counts_per_rev": Moved(("vehicle.counts_per_rev",), entered_replays=False),
    "encoders.wheel_radius_m": Moved(
        ("vehicle.wheel_radius_left_m", "vehicle.wheel_radius_right_m"), entered_replays=False
    ),
    "encoders.max_speed_mps": Moved(("vehicle.max_speed_mps",), entered_replays=False),
    "slam.association.match_base": Moved(("slam.gates.match",), lambda bound: -2.0 * bound),
    "slam.association.match_per_metre": Moved(("slam.gates.match_per_metre",), lambda bound: 2.0 * bound),
    "slam.association.match_known": Moved(("slam.gates.match_known",), lambda bound: -2.0 * bound),
    "slam.joint.match_base_square": Moved(("slam.gates.match",)),
    "slam.joint.match_per_metre_square": Moved(("slam.gates.match_per_metre",)),
    "slam.joint.match_known_square": Moved(("slam.gates.match_known",)),
}
"""In the order in which they count: what comes later is told as ignored where it contradicts."""

CONSTANTS: dict[str, dict[str, tuple[Any, str]]] = {
    "slam/estimator.py": {"slam.map_every": (10, "MAP_EVERY")},
    "slam/front_end/alignment.py": {
        "slam.front_end.alignment.scans": (5, "PAST_SCANS"),
        "slam.front_end.alignment.points": (200, "MOST_POINTS"),
        "slam.front_end.alignment.wheels_sigma_m": (0.02, "WHEELS_SIGMA_M"),
        "slam.front_end.alignment.wheels_sigma_rad": (0.01, "WHEELS_SIGMA_RAD"),
        "slam.front_end.alignment.least_points": (25, "LEAST_POINTS"),
        "slam.front_end.alignment.least_share": (0.3, "LEAST_SHARE"),
        "slam.front_end.alignment.widest_square": (30.0, "WIDEST_SQUARE"),
    },
    "slam/front_end/alignment_kernels.py": {
        "slam.front_end.alignment.sigma_m": (0.03, "SIGMA_M"),
        "slam.front_end.alignment.correlated_beams": (2.0, "CORRELATED_BEAMS"),
    },
    "slam/front_end/alignment_search.py": {
        "slam.front_end.alignment.gate_first_m": (1.0, "GATE_FIRST_M"),
        "slam.front_end.alignment.gate_last_m": (0.15, "GATE_LAST_M"),
        "slam.front_end.alignment.starts": (3, "STARTS"),
        "slam.front_end.alignment.narrowing_steps": (6, "NARROWING_STEPS"),
        "slam.front_end.alignment.final_steps": (10, "FINAL_STEPS"),
        "slam.front_end.alignment.coarse_points": (60, "COARSE_POINTS"),
    },
    "slam/front_end/corners.py": {
        "slam.front_end.line_split_m": (0.08, "LINE_SPLIT_M"),
        "slam.front_end.line_rms_m": (0.03, "LINE_RMS_M"),
        "slam.front_end.line_beams": (4, "LINE_BEAMS"),
        "slam.front_end.line_m": (0.2, "LINE_M"),
        "slam.front_end.corner_rad": (0.7, "CORNER_RAD"),
        "slam.front_end.end_spacing_m": (0.12, "END_SPACING_M"),
        "slam.front_end.sigma_corner_m": (0.02, "SIGMA_CORNER_M"),
    },
    "slam/front_end/differencing.py": {
        "slam.front_end.youngest_s": (0.4, "YOUNGEST_S"),
        "slam.front_end.oldest_s": (1.1, "OLDEST_S"),
        "slam.front_end.votes": (5, "VOTES"),
        "slam.front_end.support_share": (0.65, "SUPPORT_SHARE"),
        "slam.front_end.least_support": (2, "LEAST_SUPPORT"),
        "slam.front_end.tolerance_m": (0.12, "TOLERANCE_M"),
        "slam.front_end.tolerance_rad": (0.006, "TOLERANCE_RAD"),
        "slam.front_end.feature_tolerance_m": (0.08, "FEATURE_TOLERANCE_M"),
        "slam.front_end.difference_m": (0.1, "DIFFERENCE_M"),
    },
    "slam/front_end/spacing.py": {"slam.front_end.spacing_m": (0.1, "SPACING_M")},
    "slam/front_end/trunks.py": {
        "slam.front_end.gap_m": (0.1, "GAP_M"),
        "slam.front_end.gap_beams": (3.0, "GAP_BEAMS"),
        "slam.front_end.bridge_beams": (1, "BRIDGE_BEAMS"),
        "slam.front_end.guard_beams": (2, "GUARD_BEAMS"),
        "slam.front_end.prominence_m": (0.3, "PROMINENCE_M"),
        "slam.front_end.thin_prominence_m": (0.6, "THIN_PROMINENCE_M"),
        "slam.front_end.roughness": (0.12, "ROUGHNESS"),
    },
    "slam/joint/evidence.py": {
        "slam.joint.settled_scans": (30, "SETTLED_SCANS"),
        "slam.quality.settled_scans": (30, "SETTLED_SCANS"),
    },
    "slam/joint/association.py": {
        "slam.joint.match_widest_square": (13.816, "MATCH_WIDEST_SQUARE"),
        "slam.joint.slip_square": (100.0, "SLIP_SQUARE"),
        "slam.joint.create_square": (25.0, "CREATE_SQUARE"),
    },
    "slam/joint/gaussian.py": {
        "slam.joint.confirmed_log_odds": (3.0, "CONFIRMED_LOG_ODDS"),
        "slam.joint.association": ("own", "Variant.association"),
        "slam.joint.creation": ("licensed", "Variant.creation"),
        "slam.joint.jacobians": ("invariant", "Variant.jacobians"),
    },
    "slam/joint/state.py": {
        "slam.joint.distance_scale_sigma": (0.02, "DISTANCE_SCALE_SIGMA"),
        "slam.joint.turn_scale_sigma": (0.02, "TURN_SCALE_SIGMA"),
        "slam.joint.curvature_sigma_radpm": (0.001, "CURVATURE_SIGMA_RADPM"),
    },
    "slam/odometry/odometry.py": {
        "slam.odometry.max_yaw_rate_radps": (10.0, "MAX_YAW_RATE_RADPS"),
        "slam.odometry.rest_tolerance_counts": (1.0, "REST_TOLERANCE_COUNTS"),
    },
    "slam/odometry/wheel_segments.py": {
        "slam.odometry.gap_speed_mps": (0.5, "GAP_SPEED_MPS"),
        "slam.odometry.gap_yaw_rate_radps": (0.5, "GAP_YAW_RATE_RADPS"),
        "slam.odometry.extrapolation_s": (0.1, "EXTRAPOLATION_S"),
    },
    "slam/quality.py": {
        "slam.quality.found_share": (0.03, "FOUND_SHARE"),
        "slam.quality.lost_blind_scans": (20, "LOST_BLIND_SCANS"),
        "slam.quality.uncertain_gap_m": (1.5, "UNCERTAIN_GAP_M"),
        "slam.quality.uncertain_square": (8.0, "UNCERTAIN_SQUARE"),
        "slam.quality.lost_sigma_m": (10.0, "LOST_SIGMA_M"),
        "slam.quality.lost_sigma_rad": (1.8, "LOST_SIGMA_RAD"),
        "slam.quality.uncertain_m": (1.0, "UNCERTAIN_M"),
        "slam.quality.lost_m": (5.0, "LOST_M"),
    },
    "slam/settings/sigma_points.py": {
        "slam.unscented.alpha": (0.9, "ALPHA"),
        "slam.unscented.beta": (2.0, "BETA"),
        "slam.unscented.kappa": (0.0, "KAPPA"),
    },
    "slam/settings/tuning.py": {
        "slam.association.match_floor": (-8.0, "Tuning.match_widest_square"),
        "slam.association.match_fixed": (-4.605, "Tuning.match_fixed_square"),
        "slam.association.create_distance": (50.0, "Tuning.create_square"),
        "slam.association.log_unmatched": (-7.0, "Tuning.log_unmatched"),
        "slam.existence.new": (0.6, "Tuning.log_odds_new"),
        "slam.existence.seen": (1.0, "Tuning.log_odds_seen"),
        "slam.existence.missed": (0.7, "Tuning.log_odds_missed"),
        "slam.existence.highest": (6.0, "Tuning.log_odds_max"),
        "slam.existence.remove": (-1.0, "Tuning.log_odds_remove"),
        "slam.view.sight_margin_m": (0.5, "Tuning.sight_margin_m"),
        "slam.view.sight_half_width_m": (0.3, "Tuning.sight_half_width_m"),
        "slam.cell_m": (15.0, "Tuning.cell_m"),
    },
    "drivers/laser/connect.py": {
        "laser.connect_timeout_s": (1.0, "CONNECT_TIMEOUT_S"),
        "laser.reboot_interval_s": (5.0, "REBOOT_INTERVAL_S"),
    },
    "drivers/laser/handshake.py": {"laser.reply_timeout_s": (0.5, "REPLY_TIMEOUT_S")},
    "drivers/laser/hokuyo.py": {
        "laser.drift_max_ppm": (200.0, "DRIFT_MAX_PPM"),
        "laser.stale_after_s": (0.35, "STALE_AFTER_S"),
        "laser.silence_s": (0.5, "SILENCE_S"),
        "laser.retry_min_s": (0.1, "RETRY_MIN_S"),
        "laser.retry_max_s": (0.5, "RETRY_MAX_S"),
    },
    "drivers/laser/scans.py": {"laser.frozen_scans": (10, "FROZEN_SCANS")},
    "drivers/laser/time_adjustment.py": {"laser.time_sync_samples": (50, "TIME_SYNC_SAMPLES")},
    "drivers/wheels/encoders.py": {
        "encoders.bus.silence_s": (0.5, "SILENCE_S"),
        "encoders.bus.backoff_min_s": (0.1, "BACKOFF_MIN_S"),
        "encoders.bus.backoff_max_s": (0.5, "BACKOFF_MAX_S"),
    },
    "drivers/wheels/layouts/cia406.py": {"encoders.layout.start_nodes": (True, "START_NODES")},
    "drivers/settings/encoders.py": {
        "encoders.degraded_periods": (3.0, "DEGRADED_PERIODS"),
        "encoders.silent_periods": (10.0, "SILENT_PERIODS"),
    },
    "drivers/wheels/state.py": {"encoders.stuck_travel_m": (0.5, "STUCK_TRAVEL_M")},
    "runtime/live/run.py": {"loop.ready_s": (5.0, "READY_S")},
    "runtime/publish/publisher.py": {"publish.queue": (20, "QUEUE")},
    "runtime/publish/session.py": {"publish.lease_ms": (3000, "LEASE_MS")},
    "runtime/publish/topics.py": {
        "publish.status_hz": (1.0, "STATUS_HZ"),
        "publish.scan_beam_step": (3, "SCAN_BEAM_STEP"),
        "publish.landmarks_hz": (1.0, "SLOW_HZ"),
    },
    "runtime/live/drawing_process.py": {"review.queue": (4000, "QUEUE")},
    "runtime/review/columns.py": {"review.sigmas": (2.0, "SIGMAS")},
    "runtime/review/writer.py": {"review.trace_every": (10, "TRACE_EVERY"), "review.batch_ticks": (10, "BATCH_TICKS")},
}
"""By file: the key, the constant that it became, and that constant's name there."""

TABLES = {
    **{f"encoders.layout.{side}.info": "INFANT_* in drivers/settings/layouts.py" for side in ("left", "right")},
    "simulation.world.laser": "LaserGeometrySettings in drivers/settings/simulated_world.py",
    "laser.raw": "record.raw, which decides it",
    "encoders.layout.messages": 'a DBC file, which says the same (kind = "dbc")',
    "simulation.laser.speed_rpm": "LaserModel profiles in drivers/simulated/laser/profiles.py",
    "simulation.world.drive.corners_m": "DriveSettings in drivers/settings/simulated_world.py",
    **dict.fromkeys(("slam.view.missed_range_m", "slam.view.missed_bearing_rad"), "slam/visibility.py: beams say it"),
    "review.particles_every": "runtime/review/writer.py, which draws them on every tick",
}
"""What had no single number; no replay depends on it. Key and where to look."""

PLACES: dict[str, tuple[Any, str]] = {
    key: (value, f"{name} in {file}") for file, keys in CONSTANTS.items() for key, (value, name) in keys.items()
} | {
    f"{path}.{name}": (default, f"{model.__name__}.{name} in {model.__module__.replace('.', '/')}.py")
    for path, (model, names) in INTERNAL.items()
    for name in sorted(names)
    if isinstance(default := model.model_fields[name].default, bool | int | float | str)
}


WHEEL_FAULTS = "simulation.wheels.faults"  # whose kind was called name, unlike that of the laser's faults


def refusals(tree: Tree) -> Iterator[str]:
    """One sentence for every key of a file that is no longer a setting."""
    if any("name" in fault for fault in _wheel_faults(tree)):
        yield f"{WHEEL_FAULTS}.name: is no longer a setting; give {WHEEL_FAULTS}.kind instead"
    for key, (value, place) in PLACES.items():
        if value_at(tree, key) is not MISSING:
            yield f"{key}: is no longer a setting (it is {value}, see {place}); remove the line"
    for key, place in TABLES.items():
        if value_at(tree, key) is not MISSING:
            yield f"{key}: is no longer a setting (see {place}); remove it"
    for key, moved in MOVED.items():
        if value_at(tree, key) is not MISSING:
            yield f"{key}: is no longer a setting; give {' and '.join(moved.keys)} instead"


def translated(tree: Tree) -> tuple[Tree, list[str]]:
    """The configuration of a recorded run in the keys of today, and what of it is ignored: one phrase for each key."""
    tree, ignored = copy_of(tree), []
    if faults := _wheel_faults(tree):
        renamed = [{"kind" if key == "name" else key: value for key, value in fault.items()} for fault in faults]
        put(tree, WHEEL_FAULTS, renamed)
    for key, moved in MOVED.items():
        old = take(tree, key)
        if old is MISSING:
            continue
        value = moved.value(old)
        for new in moved.keys:
            there = value_at(tree, new)
            if there is MISSING:
                put(tree, new, value)
            elif there != value and moved.entered_replays:
                ignored.append(f"{key} = {old} is ignored, {new} is {there}")
    for key, (value, place) in PLACES.items():
        old = take(tree, key)
        if old is not MISSING and old != value:
            ignored.append(f"{key} = {old} is ignored, it is {value} ({place})")
    for key in TABLES:
        take(tree, key)
    if value_at(tree, "encoders.layout.kind") == "signals":
        for side in ("left", "right"):
            take(tree, f"encoders.layout.{side}")
        put(tree, "encoders.layout.kind", "dbc")
    if value_at(tree, "encoders.layout.file") in DELIVERED:
        take(tree, "encoders.layout.file")  # the default of today, by the name that it had
    return tree, ignored


def _wheel_faults(tree: Tree) -> list[dict[str, Any]]:
    faults = value_at(tree, WHEEL_FAULTS)
    return [fault for fault in faults if isinstance(fault, dict)] if isinstance(faults, list) else []


def ignored_settings(text: str) -> list[str]:
    """What the configuration text of a recorded run says that is not done any more, one phrase for each key."""
    return translated(tomllib.loads(text))[1]
