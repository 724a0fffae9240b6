"""What was wrong with the wheels and their bus: silence, an encoder that is stuck, damaged frames, a restart."""

import re
from collections.abc import Sequence

import numpy as np

from drivers.measurements import Event, Severity
from runtime.report.facts import RunFacts, StuckEncoder
from runtime.report.finding import (
    Finding,
    Interval,
    driver_reports,
    intervals_where,
    silences,
    spans_text,
    times_text,
)
from runtime.report.findings.silence import while_recorded
from runtime.report.findings.wheel_causes import (
    BACK_S,
    BUS,
    DAMAGE,
    GONE,
    around,
    encoders_text,
    frames_waited,
    side_of,
    silence_cause,
    wheels_text,
)
from runtime.report.wheel_calibration import WINDOW_S

SILENT_S = 0.5  # as slam.odometry.gap_s: from then on the motion is unknown
SILENT_PERIODS = 5.0
SILENT_ERROR_S = 10.0
STUCK_REPORTS = 2  # told once a second; a wheel that is set down may give one
OFTEN = 3  # reports of a kind; one bit error on a bus is no fault


def wheel_findings(facts: RunFacts) -> list[Finding]:
    """All of them, for runs with wheels."""
    known = [*_stuck(facts), *_silent(facts)]
    explained = [interval for finding in known for interval in finding.intervals]
    return [*known, *_damage(facts), *_misconfigured(facts), *_single_events(facts, explained)]


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
                "no action needed: after slam.odometry.gap_s the motion counts as unknown",
                intervals,
            )
        ]
    never = not good_s.size
    said = facts.events_ever("encoders") if never else around(facts, intervals, BACK_S)
    if any(event.kind == "stuck" for event in said):
        return []  # a count that stands still is refused, and is a finding of its own
    faults = [event for event in said if event.kind == "invalid" or event.kind in DAMAGE]
    sides = {side for event in faults if (side := side_of(event))}
    unheard = [event for event in facts.events_of("health") if "not heard so far" in event.reason]
    heard_of = [re.search(r"(left|right) wheel: not heard", event.reason) for event in unheard]
    sides |= {found.group(1) for found in heard_of if found is not None}
    one = len(sides) == 1 and not any(event.kind in (*BUS, *GONE, "silent") for event in said)
    sides = sides if one else {"left", "right"}
    waited = frames_waited(facts, intervals)
    cause, remedy = silence_cause(said, faults, sides, waited, never)
    refused = any(event.kind in DAMAGE and event.kind != "lost_together" for event in faults)
    what = "gave no usable counts" if refused else "sent nothing" if never else "stopped sending"
    when = "in the whole run" if never else f"during {spans_text(intervals)}"
    again = " and then restarted" if any(event.kind == "restart" for event in said) else ""
    return [
        Finding(
            "wheel_silent" if one else "odometry_silent",
            Severity.ERROR if never or longest >= SILENT_ERROR_S else Severity.WARN,
            f"{encoders_text(sides)} {what} {when}{again}",
            (f"no good wheel sample for up to {longest:.1f} s", *driver_reports([*said, *unheard])),
            cause,
            remedy,
            intervals,
        )
    ]


def _stuck(facts: RunFacts) -> list[Finding]:
    """By the speed signal, where the nodes send one, or else by what the laser saw of the motion."""
    events = facts.events_of("encoders", "stuck")
    if len(events) < STUCK_REPORTS:
        return [_stuck_finding({each.side}, each.intervals, _against_laser(each)) for each in facts.stuck_encoders]
    times_s = np.array([facts.seconds(event.stamp_ns) for event in events])
    intervals = intervals_where(times_s, np.ones(len(times_s), dtype=np.bool_), 3.0)
    return [_stuck_finding({side_of(event) for event in events}, intervals, driver_reports(events))]


def _against_laser(encoder: StuckEncoder) -> tuple[str, ...]:
    return (
        f"it did not count while the other wheel rolled {encoder.other_rolled_m:.2f} m in {WINDOW_S:.1f} s",
        "the laser saw no turn about this wheel",
    )


def _stuck_finding(sides: set[str], intervals: tuple[Interval, ...], evidence: tuple[str, ...]) -> Finding:
    was = "was" if len(sides) == 1 else "were"
    return Finding(
        "wheel_stuck",
        Severity.WARN,
        f"{encoders_text(sides)} {was} stuck during {spans_text(intervals)}",
        evidence,
        "the disc, coupling or channel of the encoder has failed",
        f"check coupling and channels of {wheels_text(sides)}; do not rely on the pose after that",
        intervals,
    )


def _damage(facts: RunFacts) -> list[Finding]:
    findings = []
    for kind, cause in DAMAGE.items():
        events = facts.events_of("encoders", kind)
        if not events:
            continue
        times_s = np.array([facts.seconds(event.stamp_ns) for event in events])
        intervals = intervals_where(times_s, np.ones(len(times_s), dtype=np.bool_), 3.0)
        reason = kind.replace("_", " ")
        whose = wheels_text({side for event in events if (side := side_of(event))} or {"left", "right"})
        what = "Wheel frames were lost" if kind == "lost_together" else (f"Frames of {whose} were rejected ({reason})")
        harmless = len(events) < OFTEN or kind == "lost_together"
        findings.append(
            Finding(
                "wheel_frames_lost" if kind == "lost_together" else "wheel_frames_damaged",
                Severity.INFO if harmless else Severity.WARN,
                f"{what} during {spans_text(intervals)}",
                (f"{len(events)} report{'s' * (len(events) != 1)}", *driver_reports(events, 2)),
                cause,
                "check cables and termination, and the ids of the nodes; see encoders.layout",
                intervals,
            )
        )
    return findings


def _misconfigured(facts: RunFacts) -> list[Finding]:
    events = [event for event in facts.events_of("encoders", "invalid") if "counts_per_rev" in event.reason]
    if not events:
        return []
    sides = {side for event in events if (side := side_of(event))} or {"left", "right"}
    return [
        Finding(
            "wheel_misconfigured",
            Severity.ERROR,
            f"{encoders_text(sides)} {'reports' if len(sides) == 1 else 'report'} other counts per turn "
            "than configured",
            driver_reports(events, 2),
            "the encoder or the gear differs from the configured one",
            "set vehicle.counts_per_rev to what the node reports",
        )
    ]


def _single_events(facts: RunFacts, explained: Sequence[Interval]) -> list[Finding]:
    """Things of which one is enough. explained: times without counts, after which each wheel starts again."""
    findings = []
    for kinds, name, severity, title, cause, remedy in (
        (
            ("jump",),
            "wheel_jump",
            Severity.WARN,
            "The count of {} jumped",
            "interference, or the encoder restarted",
            "check shielding and power supply of the encoder; see vehicle.max_speed_mps",
        ),
        (
            ("restart", "gap"),
            "wheel_node_restarted",
            Severity.WARN,
            "The node of {} restarted",
            "the node lost power or reset itself",
            "check the node's power supply and plug",
        ),
        (
            ("emergency",),
            "wheel_emergency",
            Severity.ERROR,
            "The node of {} raised an alarm",
            "a fault of the node itself",
            "look up the code in the manual of the node",
        ),
        (
            tuple(BUS),
            "can_bus",
            Severity.WARN,
            "The CAN bus had errors",
            "",
            "check wiring and termination; see encoders.bus.bitrate",
        ),
    ):
        events = [e for e in facts.events_of("encoders", *kinds) if not _is_explained(facts, e, explained)]
        if events:
            at = sorted({round(facts.seconds(event.stamp_ns), 1) for event in events})
            whose = wheels_text({side for event in events if (side := side_of(event))} or {"left", "right"})
            of_bus = next((why for kind, why in BUS.items() if any(event.kind == kind for event in events)), "")
            findings.append(
                Finding(
                    name,
                    severity,
                    f"{title.format(whose)} at {times_text(at)}",
                    driver_reports(events),
                    cause or of_bus,
                    remedy,
                    tuple((s, s) for s in at),
                )
            )
    return findings


def _is_explained(facts: RunFacts, event: Event, intervals: Sequence[Interval]) -> bool:
    """A wheel whose counts were away starts again, and what it turned meanwhile looks like a jump."""
    time_s = facts.seconds(event.stamp_ns)
    return event.kind in ("gap", "jump") and any(a - 0.5 <= time_s <= b + 1.0 for a, b in intervals)
