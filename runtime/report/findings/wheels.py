"""What was wrong with the wheels and their bus: silence, an encoder that is stuck, damaged frames, a restart."""

import re

import numpy as np

from drivers.measurements import Event, Severity
from runtime.report.facts import RunFacts
from runtime.report.finding import Finding, driver_reports, intervals_where, silences, spans_text, times_text
from runtime.report.findings.silence import while_recorded
from runtime.report.wheel_calibration import WINDOW_S

SILENT_S = 0.5  # as slam.odometry.gap_s: from then on the motion is unknown
SILENT_PERIODS = 5.0
SILENT_ERROR_S = 10.0
OFTEN = 3  # reports of a kind; one bit error on a bus is no fault
DAMAGE = {
    "crc": "frames arrive damaged, or another node sends under this id",
    "length": "the frames have another layout than configured",
    "standard": "the frames have another layout than configured",
    "extended": "the frames have another layout than configured",
    "fd": "CAN FD frames arrive where classic ones are expected",
    "remote": "another node requests frames under this id",
    "two_senders": "two nodes send under one id",
    "too_soon": "two nodes send under one id",
    "alive_frozen": "the node's program hangs",
    "status": "the node itself reports that its counts are not valid",
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
                f"The recording holds no odometry during {spans_text(intervals)}",
                (f"for up to {longest:.1f} s; samples are usually {usual_s:.2f} s apart",),
                "the data set holds odometry at uneven times, or the vehicle stood still",
                "nothing needs to be done: after slam.odometry.gap_s the motion counts as unknown",
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
    who = f"The {sides.pop()} wheel encoder" if one else "The wheel encoders"
    cause = _silence_cause(around, faults, one)
    return [
        Finding(
            "wheel_silent" if one else "odometry_silent",
            Severity.ERROR if longest >= SILENT_ERROR_S else Severity.WARN,
            f"{who} stopped sending during {spans_text(intervals)}",
            (f"no good wheel sample for up to {longest:.1f} s", *driver_reports([*around, *unheard])),
            cause,
            "check its power and its cable"
            if one
            else "check power and cables of both nodes and the bus; see [encoders.bus]",
            intervals,
        )
    ]


def _stuck(facts: RunFacts) -> list[Finding]:
    return [
        Finding(
            "wheel_stuck",
            Severity.WARN,
            f"The {encoder.side} wheel encoder was stuck during {spans_text(encoder.intervals)}",
            (
                f"it did not count while the other wheel rolled {encoder.other_rolled_m:.2f} m in {WINDOW_S:.1f} s",
                "the laser did not see a turn about this wheel",
            ),
            "the encoder's disc, coupling or channel has failed",
            f"check the {encoder.side} encoder's coupling and channels; do not rely on the pose from then on",
            encoder.intervals,
        )
        for encoder in facts.stuck_encoders
    ]


def _silence_cause(around: list[Event], faults: list[Event], one: bool) -> str:
    for event in around:
        if event.kind in BUS:
            return "the CAN bus is broken: wiring, termination or bit rate"
    if any("counts_per_rev" in event.reason for event in faults):
        return "its counts are refused because another node is configured"
    for event in faults:
        if event.kind in DAMAGE and event.kind != "lost_together":
            return DAMAGE[event.kind]
    return "this node lost power, or its cable came loose" if one else "both nodes lost power, or the bus is broken"


def _side(event: Event) -> str:
    found = re.match(r"(left|right) wheel", event.reason)
    return found.group(1) if found else ""


def _damage(facts: RunFacts) -> list[Finding]:
    findings = []
    for kind, cause in DAMAGE.items():
        events = facts.events_of("encoders", kind)
        if not events:
            continue
        times_s = np.array([facts.seconds(event.stamp_ns) for event in events])
        intervals = intervals_where(times_s, np.ones(len(times_s), dtype=np.bool_), 3.0)
        reason = kind.replace("_", " ")
        what = "Wheel frames were lost" if kind == "lost_together" else f"Wheel frames were refused ({reason})"
        harmless = len(events) < OFTEN or kind == "lost_together"
        findings.append(
            Finding(
                "wheel_frames_lost" if kind == "lost_together" else "wheel_frames_damaged",
                Severity.INFO if harmless else Severity.WARN,
                f"{what} during {spans_text(intervals)}",
                (f"{len(events)} reports", *driver_reports(events, 2)),
                cause,
                "check cables, termination and ids of the nodes; see encoders.layout",
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
            f"The {_side(events[0])} wheel encoder has other counts per turn than configured".replace("  ", " "),
            driver_reports(events, 2),
            "another encoder or another gear than the configuration says",
            "set vehicle.counts_per_rev to what the node reports",
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
            "A wheel's count jumped",
            "a disturbed or restarted encoder",
            "check shielding and supply of the encoder; see vehicle.max_speed_mps",
        ),
        (
            ("restart", "gap"),
            "wheel_node_restarted",
            Severity.WARN,
            "A wheel node restarted",
            "the node lost power or reset itself",
            "check the node's power supply and plug",
        ),
        (
            ("emergency",),
            "wheel_emergency",
            Severity.ERROR,
            "A wheel node raised an alarm",
            "a fault of the node itself",
            "look the code up in the node's manual",
        ),
        (
            BUS,
            "can_bus",
            Severity.WARN,
            "The CAN bus had errors",
            "wiring, termination or bit rate",
            "check wiring and termination; see encoders.bus.bitrate",
        ),
    ):
        events = facts.events_of("encoders", *kinds)
        if events:
            at = sorted({round(facts.seconds(event.stamp_ns), 1) for event in events})
            findings.append(
                Finding(
                    name,
                    severity,
                    f"{title} at {times_text(at)}",
                    driver_reports(events),
                    cause,
                    remedy,
                    tuple((s, s) for s in at),
                )
            )
    return findings
