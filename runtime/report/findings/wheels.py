"""What was wrong with the wheels and their bus: silence, an encoder that is stuck, damaged frames, a restart."""

import re

import numpy as np

from drivers.measurements import Event, Severity
from runtime.report.facts import FloatArray, RunFacts
from runtime.report.finding import Finding, intervals_where, silences, spans_text

SILENT_S = 0.5  # as slam.odometry.gap_s: from then on the motion is unknown
SILENT_PERIODS = 5.0
SILENT_ERROR_S = 10.0
STUCK_WINDOW_S = 1.5
STUCK_COUNTS = 2.0  # an encoder at an edge toggles by one
STUCK_OTHER_M = 0.35  # what the other wheel must have rolled meanwhile
STUCK_SHARE = 0.3  # of the other wheel's way that the published pose gives this wheel; a turn about it gives none
OFTEN = 3  # reports of a kind; one bit error on a bus is no fault
DAMAGE = {
    "crc": "frames arrive damaged, or another node sends under this id",
    "length": "the layout of the frames is another than configured",
    "standard": "the layout of the frames is another than configured",
    "extended": "the layout of the frames is another than configured",
    "fd": "CAN FD frames arrive where classic ones are expected",
    "remote": "a node asks under this id",
    "two_senders": "two nodes send under one id",
    "too_soon": "two nodes send under one id",
    "alive_frozen": "the node's program hangs",
    "status": "the node says that its counts are not good",
    "speed_disagrees": "the encoder, its coupling or its magnet slips",
    "lost_together": "the reader was held up, or the bus was interrupted",
}
BUS = ("bus_off", "bitrate", "error_passive", "error_warning", "restarted")


def wheel_findings(facts: RunFacts) -> list[Finding]:
    """All of them, for runs with wheels."""
    return [*_silent(facts), *_stuck(facts), *_damage(facts), *_misconfigured(facts), *_single_events(facts)]


def _silent(facts: RunFacts) -> list[Finding]:
    good_s = facts.wheels.times_s[facts.wheels.valid]
    usual_s = float(np.median(np.diff(good_s))) if good_s.size > 2 else 0.02
    intervals = silences(good_s, facts.duration_s, max(SILENT_S, SILENT_PERIODS * usual_s))
    if not intervals:
        return []
    longest = max(end - start for start, end in intervals)
    around = [
        event
        for event in facts.events_of("encoders")
        if any(start - 0.5 <= facts.seconds(event.stamp_ns) <= end + 0.5 for start, end in intervals)
    ]
    faults = [event for event in around if event.kind == "invalid" or event.kind in DAMAGE]
    sides = {side for event in faults if (side := _side(event))}
    one = len(sides) == 1 and not any(event.kind in BUS for event in around)
    who = f"{sides.pop()} wheel" if one else "odometry"
    cause = _silence_cause(around, faults, one)
    return [
        Finding(
            "wheel_silent" if one else "odometry_silent",
            Severity.ERROR if longest >= SILENT_ERROR_S else Severity.WARN,
            f"{who} silent {spans_text(intervals)}",
            (f"no good wheel sample for up to {longest:.1f} s", *_told(around)),
            cause,
            "check power and cable of the node" + ("" if one else "s and the bus; [encoders.bus]"),
            intervals,
        )
    ]


def _silence_cause(around: list[Event], faults: list[Event], one: bool) -> str:
    for event in around:
        if event.kind in BUS:
            return "the CAN bus is broken: wiring, termination or bit rate"
    for event in faults:
        if event.kind in DAMAGE and event.kind != "lost_together":
            return DAMAGE[event.kind]
    return "this node lost power or its cable" if one else "both nodes lost power, or the bus is broken"


def _side(event: Event) -> str:
    found = re.match(r"(left|right) wheel", event.reason)
    return found.group(1) if found else ""


def _told(events: list[Event], most: int = 3) -> tuple[str, ...]:
    return tuple(f"driver: {event.reason}" for event in events[:most])


def _stuck(facts: RunFacts) -> list[Finding]:
    """A wheel that counts nothing while the other rolls and the published pose says that it rolls too."""
    odometry, wheels = facts.configuration.slam.odometry, facts.wheels
    good = wheels.valid & np.isfinite(wheels.counts[:, 0])
    if odometry.model != "differential" or good.sum() < 10 or facts.ticks.times_s.size < 20:
        return []
    ends = facts.ticks.times_s[facts.ticks.times_s >= STUCK_WINDOW_S]
    begins = ends - STUCK_WINDOW_S
    good_s = wheels.times_s[good]
    counts = _between(good_s, wheels.counts[good], begins, ends)
    radii = np.array((odometry.wheel_radius_left_m, odometry.wheel_radius_right_m))
    rolled_m = np.abs(counts) * 2.0 * np.pi * radii / odometry.counts_per_rev
    by_pose_m = _travel_by_pose(facts, begins, ends, odometry.tread_m)
    covered = np.searchsorted(good_s, ends) > np.searchsorted(good_s, begins)
    findings = []
    for own, side in enumerate(("left", "right")):
        other = 1 - own
        still = (np.abs(counts[:, own]) <= STUCK_COUNTS) & (rolled_m[:, other] >= STUCK_OTHER_M) & covered
        still &= np.abs(by_pose_m[:, own]) >= STUCK_SHARE * rolled_m[:, other]
        windows = intervals_where(ends, still, 1.0, 0.2)
        intervals = tuple((start - STUCK_WINDOW_S, end) for start, end in windows)
        if intervals:
            findings.append(
                Finding(
                    "wheel_stuck",
                    Severity.WARN,
                    f"{side} encoder stuck {spans_text(intervals)}",
                    (
                        f"no count while the other wheel rolled {rolled_m[still, other].max():.2f} m in "
                        f"{STUCK_WINDOW_S:.1f} s and the pose went on",
                        *_told([e for e in facts.events_of("encoders", "stuck", "still") if _side(e) == side], 2),
                    ),
                    "the encoder's disc, coupling or channel has failed, or the wheel is blocked",
                    f"check the {side} encoder's coupling and channels",
                    intervals,
                )
            )
    return findings


def _between(times_s: FloatArray, values: FloatArray, begins: FloatArray, ends: FloatArray) -> FloatArray:
    columns = [np.interp(ends, times_s, column) - np.interp(begins, times_s, column) for column in values.T]
    return np.stack(columns, axis=-1)


def _travel_by_pose(facts: RunFacts, begins: FloatArray, ends: FloatArray, tread_m: float) -> FloatArray:
    """Way of the left and the right wheel by the published pose, (n, 2) m."""
    poses = facts.ticks.estimated
    heading = np.unwrap(poses[:, 2])
    steps = np.diff(poses[:, :2], axis=0)
    middle = 0.5 * (heading[1:] + heading[:-1])
    ahead = np.concatenate(((0.0,), np.cumsum(steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle))))
    tracks = np.stack((ahead - 0.5 * tread_m * heading, ahead + 0.5 * tread_m * heading), axis=-1)
    return _between(facts.ticks.times_s, tracks, begins, ends)


def _damage(facts: RunFacts) -> list[Finding]:
    findings = []
    for kind, cause in DAMAGE.items():
        events = facts.events_of("encoders", kind)
        if not events:
            continue
        times_s = np.array([facts.seconds(event.stamp_ns) for event in events])
        intervals = intervals_where(times_s, np.ones(len(times_s), dtype=np.bool_), 3.0)
        harmless = len(events) < OFTEN or kind == "lost_together"
        findings.append(
            Finding(
                "wheel_frames_lost" if kind == "lost_together" else "wheel_frames_damaged",
                Severity.INFO if harmless else Severity.WARN,
                f"wheel frames: {kind.replace('_', ' ')}, {spans_text(intervals)}",
                (f"{len(events)} reports", *_told(events, 2)),
                cause,
                "cable, termination and ids of the nodes; encoders.layout",
                intervals,
            )
        )
    return findings


def _misconfigured(facts: RunFacts) -> list[Finding]:
    events = [event for event in facts.events_of("encoders", "invalid") if "counts_per_rev" in event.reason]
    if not events:
        return []
    return [
        Finding(
            "wheel_misconfigured",
            Severity.ERROR,
            f"{_side(events[0])} node is not the one configured: counts per turn differ".strip(),
            _told(events, 2),
            "another encoder or another gear than the configuration says",
            "encoders.counts_per_rev and slam.odometry.counts_per_rev: what the node reports",
        )
    ]


def _single_events(facts: RunFacts) -> list[Finding]:
    """Things of which one is enough."""
    findings = []
    for kinds, name, severity, title, cause, remedy in (
        (("jump",), "wheel_jump", Severity.WARN, "a wheel's count jumps", "a disturbed or restarted encoder",
         "check shielding and supply of the encoder; slam.odometry.max_speed_mps"),
        (("restart", "gap"), "wheel_node_restarted", Severity.WARN, "a wheel node began anew",
         "the node lost power or reset itself", "check the node's power supply and plug"),
        (("emergency",), "wheel_emergency", Severity.ERROR, "a node raises an alarm", "a fault of the node itself",
         "look the code up in the node's manual"),
        (BUS, "can_bus", Severity.WARN, "the CAN bus has errors", "wiring, termination or bit rate",
         "check wiring and termination; encoders.bus.bitrate"),
    ):  # fmt: skip
        events = facts.events_of("encoders", *kinds)
        if events:
            at = sorted({round(facts.seconds(event.stamp_ns), 1) for event in events})
            text = ", ".join(f"{second:.1f} s" for second in at[:4]) + (f" and {len(at) - 4} more" if at[4:] else "")
            findings.append(
                Finding(name, severity, f"{title} at {text}", _told(events), cause, remedy, tuple((s, s) for s in at))
            )
    return findings
