"""What was wrong with the wheels and their bus: silence, an encoder that is stuck, damaged frames, a restart."""

import re

import numpy as np

from drivers.measurements import Event, Severity
from runtime.report.facts import RunFacts
from runtime.report.finding import Finding, intervals_where, silences, spans_text
from runtime.report.findings.silence import while_recorded
from runtime.report.wheel_calibration import WINDOW_S

SILENT_S = 0.5  # as slam.odometry.gap_s: from then on the motion is unknown
SILENT_PERIODS = 5.0
SILENT_ERROR_S = 10.0
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
    intervals = while_recorded(facts, silences(good_s, facts.duration_s, max(SILENT_S, SILENT_PERIODS * usual_s)))
    if not intervals:
        return []
    longest = max(end - start for start, end in intervals)
    if facts.imported:
        return [
            Finding(
                "recording_without_odometry",
                Severity.INFO,
                f"the recording holds no odometry {spans_text(intervals)}",
                (f"for up to {longest:.1f} s; its usual distance is {usual_s:.2f} s",),
                "the data set holds odometry at uneven times, or the vehicle stood still",
                "nothing: slam.odometry.gap_s says from when on the motion counts as unknown",
                intervals,
            )
        ]
    around = [
        event
        for event in facts.events_of("encoders")
        if any(start - 0.5 <= facts.seconds(event.stamp_ns) <= end + 0.5 for start, end in intervals)
    ]
    faults = [event for event in around if event.kind == "invalid" or event.kind in DAMAGE]
    sides = {side for event in faults if (side := _side(event))}
    unheard = [event for event in facts.events_of("health") if "not heard so far" in event.reason]
    heard_of = [re.search(r"(left|right) wheel: not heard", event.reason) for event in unheard]
    sides |= {found.group(1) for found in heard_of if found is not None}
    one = len(sides) == 1 and not any(event.kind in BUS for event in around)
    who = f"{sides.pop()} wheel" if one else "odometry"
    cause = _silence_cause(around, faults, one)
    return [
        Finding(
            "wheel_silent" if one else "odometry_silent",
            Severity.ERROR if longest >= SILENT_ERROR_S else Severity.WARN,
            f"{who} silent {spans_text(intervals)}",
            (f"no good wheel sample for up to {longest:.1f} s", *_told([*around, *unheard])),
            cause,
            "check power and cable of the node" + ("" if one else "s and the bus; [encoders.bus]"),
            intervals,
        )
    ]


def _stuck(facts: RunFacts) -> list[Finding]:
    return [
        Finding(
            "wheel_stuck",
            Severity.WARN,
            f"{encoder.side} encoder stuck {spans_text(encoder.intervals)}",
            (
                f"no count while the other wheel rolled {encoder.other_rolled_m:.2f} m in {WINDOW_S:.1f} s",
                "the laser does not see a turn about this wheel",
            ),
            "the encoder's disc, coupling or channel has failed",
            f"check the {encoder.side} encoder's coupling and channels; the pose is wrong from then on",
            encoder.intervals,
        )
        for encoder in facts.stuck_encoders
    ]


def _silence_cause(around: list[Event], faults: list[Event], one: bool) -> str:
    for event in around:
        if event.kind in BUS:
            return "the CAN bus is broken: wiring, termination or bit rate"
    if any("counts_per_rev" in event.reason for event in faults):
        return "its counts are refused because it is not the node that is configured"
    for event in faults:
        if event.kind in DAMAGE and event.kind != "lost_together":
            return DAMAGE[event.kind]
    return "this node lost power or its cable" if one else "both nodes lost power, or the bus is broken"


def _side(event: Event) -> str:
    found = re.match(r"(left|right) wheel", event.reason)
    return found.group(1) if found else ""


def _told(events: list[Event], most: int = 3) -> tuple[str, ...]:
    return tuple(f"driver: {event.reason}" for event in events[:most])


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
            "vehicle.counts_per_rev: what the node reports",
        )
    ]


def _single_events(facts: RunFacts) -> list[Finding]:
    """Things of which one is enough."""
    findings = []
    for kinds, name, severity, title, cause, remedy in (
        (
            ("jump",),
            "wheel_jump",
            Severity.WARN,
            "a wheel's count jumps",
            "a disturbed or restarted encoder",
            "check shielding and supply of the encoder; vehicle.max_speed_mps",
        ),
        (
            ("restart", "gap"),
            "wheel_node_restarted",
            Severity.WARN,
            "a wheel node began anew",
            "the node lost power or reset itself",
            "check the node's power supply and plug",
        ),
        (
            ("emergency",),
            "wheel_emergency",
            Severity.ERROR,
            "a node raises an alarm",
            "a fault of the node itself",
            "look the code up in the node's manual",
        ),
        (
            BUS,
            "can_bus",
            Severity.WARN,
            "the CAN bus has errors",
            "wiring, termination or bit rate",
            "check wiring and termination; encoders.bus.bitrate",
        ),
    ):
        events = facts.events_of("encoders", *kinds)
        if events:
            at = sorted({round(facts.seconds(event.stamp_ns), 1) for event in events})
            text = ", ".join(f"{second:.1f} s" for second in at[:4]) + (f" and {len(at) - 4} more" if at[4:] else "")
            findings.append(
                Finding(name, severity, f"{title} at {text}", _told(events), cause, remedy, tuple((s, s) for s in at))
            )
    return findings
