"""Whether the geometry that was configured is the one that drove: by calibration from this very run."""

import math

from drivers.measurements import Severity
from runtime.calibrate.calibration import calibrate
from runtime.calibrate.drive_data import CalibrationStart
from runtime.calibrate.recorded_drives import start_from
from runtime.calibrate.result import Calibration, Quantity
from runtime.errors import DataSetError
from runtime.report.facts import RunFacts
from runtime.report.finding import Finding

SURE = 4.0  # standard deviations: seven quantities in 100 healthy runs give less than one false report
LEAST_RADIUS = 0.004  # share; less is a degree in ten metres of way and within a tyre's pressure
LEAST_TREAD = 0.02  # share; the same in a full turn is 7 deg
LEAST_YAW_RAD = math.radians(0.8)  # 0.3 m in 20 m
LEAST_OFFSET_M = 0.05
LEAST_LATENCY_S = 0.03  # 1.5 cm at the rover's speed, 1 deg in a turn
NORMAL_95 = 1.96


def geometry_findings(facts: RunFacts) -> list[Finding]:
    """Deviations that are both certain and large enough to matter."""
    if facts.drive is None:
        return []
    try:
        start = start_from(facts.configuration)
        result = calibrate([facts.drive], start)
    except DataSetError:
        return []  # this kind of odometry has no wheels to compare
    findings = _disagreement(result)
    if not isinstance(start, CalibrationStart) or findings:
        return findings
    return [*_radii(result, start), *_tread(result, start), *_mount(result, start), *_latency(result)]


def _disagreement(result: Calibration) -> list[Finding]:
    """Nothing fits at all: not wear, but a wrong number."""
    for sentence in result.missing:
        if sentence.startswith("wheels and laser agree") or "too far from" in sentence:
            return [
                Finding(
                    "wheels_laser_disagree",
                    Severity.WARN,
                    "the wheels and the laser do not tell of the same motion",
                    (sentence,),
                    "a wrong count per turn, sign, radius or mount; or wheels that slip all the time",
                    "slam.odometry.counts_per_rev, slam.odometry.wheel_radius_left_m, _right_m and slam.mount",
                )
            ]
    return []


def _deviation(quantity: Quantity) -> float:
    return quantity.half_width / NORMAL_95


def _ratio_text(ratio: float) -> str:
    return f"{abs(ratio):.1%} {'larger' if ratio > 0 else 'smaller'}"


def _radii(result: Calibration, start: CalibrationStart) -> list[Finding]:
    left, right = result.reported("wheel_radius_left_m"), result.reported("wheel_radius_right_m")
    if left is None or right is None:
        return []
    ratios = (left.value / start.wheel_radius_left_m - 1.0, right.value / start.wheel_radius_right_m - 1.0)
    sigmas = (_deviation(left) / start.wheel_radius_left_m, _deviation(right) / start.wheel_radius_right_m)
    apart, apart_sigma = ratios[0] - ratios[1], math.hypot(*sigmas)
    both, both_sigma = 0.5 * (ratios[0] + ratios[1]), max(sigmas)  # their errors go together
    evidence = (
        f"left {left.value:.4f} m ({left.low:.4f} to {left.high:.4f}), configured {start.wheel_radius_left_m:g}",
        f"right {right.value:.4f} m ({right.low:.4f} to {right.high:.4f}), configured {start.wheel_radius_right_m:g}",
    )
    remedy = f"slam.odometry.wheel_radius_left_m = {left.value:.4f}, wheel_radius_right_m = {right.value:.4f}"
    if abs(apart) >= LEAST_RADIUS and abs(apart) > SURE * apart_sigma:
        side, ratio = ("left", ratios[0]) if abs(ratios[0]) >= abs(ratios[1]) else ("right", ratios[1])
        cause = f"tyre pressure, load or wear of the {side} wheel"
        title = f"{side} wheel {_ratio_text(ratio)} than configured"
        if min(map(abs, ratios)) > 0.5 * abs(ratio):  # both sides share it: which one is worn is not known
            title = f"left wheel {_ratio_text(apart)} against the right than configured"
            cause = "tyre pressure, load or wear of one wheel"
        return [Finding("wheel_radius_difference", Severity.WARN, title, evidence, cause, remedy)]
    if abs(both) >= LEAST_RADIUS and abs(both) > SURE * both_sigma:
        title = f"both wheels {_ratio_text(both)} than configured: distances are wrong by as much"
        return [Finding("wheel_scale", Severity.WARN, title, evidence, "radius or counts per turn are wrong", remedy)]
    return []


def _tread(result: Calibration, start: CalibrationStart) -> list[Finding]:
    found = result.reported("tread_m")
    if found is None:
        return []
    ratio, sigma = found.value / start.tread_m - 1.0, _deviation(found) / start.tread_m
    if abs(ratio) < LEAST_TREAD or abs(ratio) <= SURE * sigma:
        return []
    return [
        Finding(
            "tread",
            Severity.WARN,
            f"the wheels stand {found.value:.3f} m apart, {_ratio_text(ratio)} than configured: turns are wrong",
            (f"{found.low:.3f} to {found.high:.3f} m (95 %), configured {start.tread_m:g} m",),
            "the tread was measured between other points than where the wheels touch the ground",
            f"slam.odometry.tread_m = {found.value:.3f}",
        )
    ]


def _mount(result: Calibration, start: CalibrationStart) -> list[Finding]:
    mount = start.body_from_laser
    findings = []
    yaw = result.reported("laser_yaw_rad")
    if yaw is not None:
        off = yaw.value - mount.heading_rad
        if abs(off) >= LEAST_YAW_RAD and abs(off) > SURE * _deviation(yaw):
            findings.append(
                Finding(
                    "laser_yaw",
                    Severity.WARN,
                    f"laser yaw offset {math.degrees(off):+.1f} deg",
                    (f"{yaw.low:.4f} to {yaw.high:.4f} rad (95 %), configured {mount.heading_rad:g}",),
                    "the laser is turned on its mount",
                    f"slam.mount.yaw_rad = {yaw.value:.4f}",
                )
            )
    for name, axis, configured in (("laser_x_m", "x", mount.x_m), ("laser_y_m", "y", mount.y_m)):
        found = result.reported(name)
        if found is None:
            continue
        off = found.value - configured
        if abs(off) >= LEAST_OFFSET_M and abs(off) > SURE * _deviation(found):
            findings.append(
                Finding(
                    "laser_offset",
                    Severity.WARN,
                    f"the laser stands {abs(off) * 100.0:.0f} cm from where it is configured ({axis})",
                    (f"{axis} {found.low:.3f} to {found.high:.3f} m (95 %), configured {configured:g}",),
                    "the mount was measured from another point than the middle of the axle",
                    f"slam.mount.{axis}_m = {found.value:.3f}",
                )
            )
    return findings


def _latency(result: Calibration) -> list[Finding]:
    found = result.reported("laser_latency_s")
    if found is None or abs(found.value) < LEAST_LATENCY_S or abs(found.value) <= SURE * _deviation(found):
        return []
    early_or_late = "late" if found.value > 0 else "early"
    return [
        Finding(
            "laser_latency",
            Severity.WARN,
            f"laser latency: scans are stamped {abs(found.value) * 1e3:.0f} ms {early_or_late}",
            (f"{found.low * 1e3:.0f} to {found.high * 1e3:.0f} ms (95 %), from turns against the wheels",),
            "a delay between measurement and stamp that the configuration does not know, or late wheel stamps",
            f"laser.stamp_offset_s: change it by {-found.value:+.3f}",
        )
    ]
