"""Which findings follow from which others: a reviewer reads the cause first, however grave its consequences are."""

from collections.abc import Sequence
from dataclasses import replace

from drivers.measurements import Severity
from runtime.report.finding import RANKS, Finding, Interval

LEAD_S = 0.5  # a cause may be seen this much after what follows from it, and no more
ECHO_S = 5.0  # a pose needs some seconds to be sure again after what put it in doubt
SENSORS = ("laser_", "scan_", "wheel", "odometry_", "can_", "storage_", "tread", "missed_beats")
UPSTREAM = ("defect", *SENSORS)
FOLLOWERS = {  # kind that follows: kinds that may be its cause, and whether they must fall into the same seconds
    "laser_silent": (("scan_stamps_jump", "laser_checksum", "laser_frozen", "laser_late"), True),
    "laser_scans_lost": (("laser_checksum", "laser_frozen", "scan_stamps_jump", "missed_beats"), True),
    "laser_scans_superseded": (("missed_beats",), True),
    "wheel_node_restarted": (("wheel_silent", "odometry_silent", "wheel_stuck"), True),
    "wheel_jump": (("wheel_silent", "odometry_silent", "wheel_stuck"), True),
    "wheel_frames_damaged": (("wheel_silent", "odometry_silent", "wheel_stuck"), True),
    "can_bus": (("odometry_silent",), True),
    "pose_lost": (UPSTREAM, True),
    "pose_uncertain": (UPSTREAM, True),
    "pose_jumps": (UPSTREAM, True),
    "no_landmarks": (UPSTREAM, True),
    "parted_from_smoothed": (("wrong_matches",), True),
    "worse_than_odometry": ((*UPSTREAM, "pose_"), False),
    "underconfident": (UPSTREAM, False),
    "overconfident": ((*UPSTREAM, "pose_", "worse_"), False),
}


def ordered(findings: Sequence[Finding]) -> list[Finding]:
    """Causes first, the gravest of them at the top; behind them what follows from another, with that as its cause."""
    linked = [_following(finding, findings) for finding in findings]
    return sorted(linked, key=lambda finding: (bool(finding.follows), -RANKS[finding.severity]))


def _following(finding: Finding, findings: Sequence[Finding]) -> Finding:
    causes, at_once = FOLLOWERS.get(finding.kind, ((), False))
    grave = [other for other in findings if other.severity is not Severity.INFO and other.kind.startswith(causes)]
    if not causes:
        return finding
    for cause in grave:
        within, of = _within(finding.intervals, cause.intervals) if at_once else (1, 1)
        if cause is not finding and 2 * within >= of:
            share = f"{within} of {of} times " if within < of else ""
            told = f"{share}it follows from: {cause.title}"
            return replace(finding, follows=cause.kind, cause=told, remedy="see that finding")
    return finding


def _within(consequences: Sequence[Interval], causes: Sequence[Interval]) -> tuple[int, int]:
    """How many of them begin during a cause or soon after it, of how many; a cause without times lasts all the time."""
    if not causes:
        return 1, 1
    within = [any(begin - LEAD_S <= start <= end + ECHO_S for begin, end in causes) for start, _ in consequences]
    return sum(within), max(1, len(within))
