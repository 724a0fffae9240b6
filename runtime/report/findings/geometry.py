"""Whether the geometry that was configured is the one that drove: by calibration from this very run."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.measurements import Severity
from runtime.calibrate.result import Calibration
from runtime.calibrate.single_causes import Cause, Fit, single_causes
from runtime.report.facts import GeometryRow, RunFacts
from runtime.report.finding import Finding
from slam.pose import wrap_rad

LEAST_RADIUS = 0.004  # share; less is a degree in ten metres of way and within a tyre's pressure
LEAST_TREAD = 0.02  # share; the same in a full turn is 7 deg
LEAST_YAW_RAD = math.radians(0.8)  # 0.3 m in 20 m
LEAST_OFFSET_M = 0.05
LEAST_LATENCY_S = 0.03  # 1.5 cm at the rover's speed, 1 deg in a turn
NORMAL_95 = 1.96
LEFT, RIGHT, BOTH = "left", "right", "both"
WHEELS = {  # cause: shares of the radii
    LEFT: {"wheel_radius_left_m": 1.0},
    RIGHT: {"wheel_radius_right_m": 1.0},
    BOTH: {"wheel_radius_left_m": 1.0, "wheel_radius_right_m": 1.0},
}


@dataclass(frozen=True, slots=True)
class Place:
    """A parameter of the geometry: least deviation that matters in its own unit (relative: share of the start), the
    same in what the page shows, and the page's unit.
    """

    label: str
    least: float
    relative: bool
    shown: float
    unit: str
    key: str


PLACES = {
    "wheel_radius_left_m": Place(
        "radius of the left wheel", LEAST_RADIUS, True, 1e3, "mm", "vehicle.wheel_radius_left_m"
    ),
    "wheel_radius_right_m": Place(
        "radius of the right wheel", LEAST_RADIUS, True, 1e3, "mm", "vehicle.wheel_radius_right_m"
    ),
    "tread_m": Place("distance between the wheels", LEAST_TREAD, True, 1e3, "mm", "vehicle.tread_m"),
    "laser_x_m": Place("laser ahead of the axle", LEAST_OFFSET_M, False, 1e3, "mm", "slam.mount.x_m"),
    "laser_y_m": Place("laser left of the middle", LEAST_OFFSET_M, False, 1e3, "mm", "slam.mount.y_m"),
    "laser_yaw_rad": Place(
        "laser turned to the left", LEAST_YAW_RAD, False, math.degrees(1.0), "deg", "slam.mount.yaw_rad"
    ),
    "laser_latency_s": Place("stamps of the laser late by", LEAST_LATENCY_S, False, 1e3, "ms", "laser.stamp_offset_s"),
}


def geometry_rows(facts: RunFacts) -> tuple[GeometryRow, ...]:
    """What was configured, what this run shows, and what it could have shown, for runs with two driven wheels."""
    fit = _fit(facts)
    if fit is None or facts.calibration is None:
        return ()
    rows = []
    for index, name in enumerate(fit.names):
        place, found = PLACES[name], facts.calibration.quantity(name)
        detectable = fit.detectable(fit.direction({name: 1.0}))
        span = None if found.refused else (found.low * place.shown, found.high * place.shown)
        rows.append(
            GeometryRow(place.label, place.unit, float(fit.start[index]) * place.shown, span, detectable * place.shown)
        )
    return tuple(rows)


def geometry_findings(facts: RunFacts) -> list[Finding]:
    """Deviations that are both certain and large enough to matter, as few as explain the run."""
    oriented = [*_mirrored(facts), *_turned(facts)]
    if facts.calibration is None:
        return oriented
    fit = _fit(facts)
    if fit is None:
        return oriented or _disagreement(facts.calibration)
    directions = {name: fit.direction({name: 1.0}) for name in fit.names if not name.startswith("wheel_radius")}
    causes = single_causes(fit, {name: fit.direction(shares) for name, shares in WHEELS.items()} | directions)
    return [*oriented, *_radii(fit, causes), *_others(fit, causes)]


def _mirrored(facts: RunFacts) -> list[Finding]:
    """The laser turns left where the wheels turn right."""
    if not facts.orientation.mirrored:
        return []
    believed = facts.configuration.slam.mount.upside_down
    return [
        Finding(
            "laser_mirrored",
            Severity.ERROR,
            "The scans are mirrored: they turn left when the wheels turn right",
            ("wheels and scans agree if left and right are swapped in every scan, and disagree as configured",),
            "the laser is upright, but the configuration says upside down"
            if believed
            else "the laser hangs upside down, or the left and right wheels are swapped",
            f"set slam.mount.upside_down = {str(not believed).lower()}; swap the wheels if it is the map "
            "that is mirrored",
        )
    ]


def _turned(facts: RunFacts) -> list[Finding]:
    """The laser looks backwards or to a side."""
    turned_rad = facts.orientation.turned_rad
    if not turned_rad:
        return []
    yaw_rad = wrap_rad(facts.configuration.slam.mount.yaw_rad + turned_rad)
    return [
        Finding(
            "laser_yaw",
            Severity.ERROR,
            f"The laser is turned by {math.degrees(turned_rad):+.0f} deg from its configured yaw",
            ("wheels and scans agree if the mount is turned by that angle, and disagree as configured",),
            "the laser faces backwards or sideways",
            f"set slam.mount.yaw_rad = {yaw_rad:.4f}",
        )
    ]


def _fit(facts: RunFacts) -> Fit | None:
    fit = None if facts.calibration is None else facts.calibration.fit
    return fit if fit is not None and set(fit.names) == set(PLACES) else None


def _disagreement(result: Calibration) -> list[Finding]:
    """Nothing fits at all: not wear, but a wrong number."""
    if not result.contradicts_start:
        return []
    return [
        Finding(
            "wheels_laser_disagree",
            Severity.WARN,
            "The wheels and the laser disagree about the motion",
            result.missing[:1],
            "counts per turn, a sign, a radius or the mount is wrong, or the wheels slip all the time",
            "check vehicle.counts_per_rev, vehicle.wheel_radius_left_m, _right_m and slam.mount",
        )
    ]


def _ratio_text(ratio: float) -> str:
    return f"{abs(ratio):.1%} {'larger' if ratio > 0 else 'smaller'}"


def _radii(fit: Fit, causes: Sequence[Cause]) -> list[Finding]:
    """One finding for both wheels together."""
    wheels = [cause for cause in causes if cause.name in WHEELS]
    start_m = fit.start[[fit.names.index(name) for name in ("wheel_radius_left_m", "wheel_radius_right_m")]]
    off_m = [sum(cause.value for cause in wheels if cause.name in (side, BOTH)) for side in (LEFT, RIGHT)]
    left, right = (float(off) / float(start) for off, start in zip(off_m, start_m, strict=True))
    if not wheels or max(abs(left), abs(right)) < LEAST_RADIUS:
        return []
    evidence = [_evidence(cause, f"{cause.name} wheel{'s' if cause.name == BOTH else ''}") for cause in wheels]
    radii = (left * start_m[0] + start_m[0], right * start_m[1] + start_m[1])
    remedy = f"set vehicle.wheel_radius_left_m = {radii[0]:.4f}, wheel_radius_right_m = {radii[1]:.4f}"
    if abs(left - right) < LEAST_RADIUS:
        title = f"Both wheels are {_ratio_text(0.5 * (left + right))} than configured, and so are all distances"
        cause_text = "the radii or the counts per turn are wrong"
        return [Finding("wheel_scale", Severity.WARN, title, tuple(evidence), cause_text, remedy)]
    if len(wheels) > 1 and min(abs(left), abs(right)) >= LEAST_RADIUS:
        title = f"The left wheel is {_ratio_text(left)} and the right wheel {_ratio_text(right)} than configured"
        cause_text = "tyre pressure, load or wear of both wheels"
    else:
        side, ratio = (LEFT, left) if abs(left) >= abs(right) else (RIGHT, right)
        title = f"The {side} wheel is {_ratio_text(ratio)} than configured"
        cause_text = f"tyre pressure, load or wear of the {side} wheel"
        other = RIGHT if side == LEFT else LEFT
        if other in wheels[0].rivals:  # the drive does not show which of the two it is
            title += f", or the {other} wheel {_ratio_text(-ratio)}"
            cause_text = "tyre pressure, load or wear of one wheel"
    return [Finding("wheel_radius_difference", Severity.WARN, title, tuple(evidence), cause_text, remedy)]


def _evidence(cause: Cause, what: str, shown: float = 1e3, unit: str = "mm") -> str:
    off = float(f"{cause.value * shown:.3g}")  # the last digits say nothing, and people read no exponents
    half = float(f"{NORMAL_95 * cause.deviation * shown:.2g}")
    return (
        f"{what}: {off:+g} {unit} from the configured value, +- {half:g} (95 %); "
        f"{cause.significance:.1f} standard deviations, from matching scans against the wheels"
    )


def _others(fit: Fit, causes: Sequence[Cause]) -> list[Finding]:
    findings = []
    for cause in causes:
        if cause.name in WHEELS:
            continue
        place, start = PLACES[cause.name], float(fit.start[fit.names.index(cause.name)])
        if abs(cause.value) < place.least * (abs(start) if place.relative else 1.0):
            continue
        kind, title, likely, remedy = _said(cause.name, cause.value, start)
        evidence = _evidence(cause, place.label, place.shown, place.unit)
        findings.append(Finding(kind, Severity.WARN, title, (evidence,), likely, remedy))
    return findings


def _said(name: str, off: float, start: float) -> tuple[str, str, str, str]:
    """Kind, title, likely cause and remedy."""
    key, value = PLACES[name].key, start + off
    if name == "tread_m":
        return (
            "tread",
            f"The tread is {value:.3f} m, {_ratio_text(off / start)} than configured; turns are wrong by "
            "the same ratio",
            "the tread was not measured between the points where the wheels touch the ground",
            f"set {key} = {value:.3f}",
        )
    if name == "laser_yaw_rad":
        return (
            "laser_yaw",
            f"The laser is turned by {math.degrees(off):+.1f} deg from its configured yaw",
            "the laser is turned on its mount",
            f"set {key} = {value:.4f}",
        )
    if name == "laser_latency_s":
        return (
            "laser_latency",
            f"Scans are stamped {abs(off) * 1e3:.0f} ms {'late' if off > 0 else 'early'}",
            "a delay between measurement and stamp that is not configured, or late wheel stamps",
            f"change {key} by {-off:+.3f}",
        )
    axis = "x" if name == "laser_x_m" else "y"
    return (
        "laser_offset",
        f"The laser is mounted {abs(off) * 100.0:.0f} cm from its configured position ({axis})",
        "the mount was not measured from the middle of the axle",
        f"{key} = {value:.3f}",
    )
