"""What was wrong with the host: beats missed or late, and a record that has holes."""

from collections import Counter

import numpy as np

from drivers.measurements import Severity
from runtime.report.facts import RunFacts
from runtime.report.finding import Finding, intervals_where, spans_text, times_text

MISSED_SHARE = 0.005  # of the beats: one in 20 s
MISSED_ERROR_SHARE = 0.05
LATE_MS = 20.0  # a fifth of a beat; a real-time thread stays under 1
LATE_SHARE = 0.01
SLOW_SHARE = 0.6  # of the beat for the filter; what else runs needs the rest
SHORT_S = 5.0  # two of them are rest, for the heading of the map; from less nothing can be told
NOTHING_S = 2.0  # the rover has not moved yet
PATH_OF_LOOP = "set loop.priority = 50, lower slam.particles, or run less other work on the host"


def running_findings(facts: RunFacts) -> list[Finding]:
    """All of them; a replay has the beats of the drive it was made from."""
    beats = (*_missed(facts), *_late(facts), *_slow(facts))
    return [*_short(facts), *beats, *_storage(facts), *_failed_steps(facts), *_errors(facts)]


def _short(facts: RunFacts) -> list[Finding]:
    if facts.duration_s >= SHORT_S:
        return []
    return [
        Finding(
            "short_run",
            Severity.ERROR if facts.duration_s < NOTHING_S else Severity.WARN,
            f"Only {facts.duration_s:.1f} s were recorded, too little to judge the run",
            (f"{facts.ticks.times_s.size} ticks; at least {SHORT_S:.0f} s are needed",),
            "the run was stopped immediately, or ended early",
            "record for longer; the last lines of the log say why it ended",
        )
    ]


def _missed(facts: RunFacts) -> list[Finding]:
    missed = facts.ticks.missed
    total = int(missed.sum())
    if not total:
        return []
    share = total / (missed.size + total)
    severity = Severity.INFO if share < MISSED_SHARE else Severity.WARN
    severity = Severity.ERROR if share >= MISSED_ERROR_SHARE else severity
    intervals = intervals_where(facts.ticks.times_s, missed > 0, 3.0)
    return [
        Finding(
            "missed_beats",
            severity,
            f"The loop missed {total} beats ({share:.1%}) during {spans_text(intervals)}",
            (f"at most {int(missed.max())} in a row",),
            "the host was busy, or a step of the filter took longer than a beat",
            PATH_OF_LOOP,
            intervals,
        )
    ]


def _late(facts: RunFacts) -> list[Finding]:
    late_ms = facts.ticks.lateness_ms[np.isfinite(facts.ticks.lateness_ms)]
    if late_ms.size < 20:
        return []
    late = late_ms > LATE_MS
    if late.mean() < LATE_SHARE:
        return []
    p99 = np.percentile(late_ms, 99)
    return [
        Finding(
            "late_beats",
            Severity.WARN,
            f"{late.mean():.1%} of the beats began more than {LATE_MS:.0f} ms late (99 % within {p99:.0f} ms)",
            (f"the latest of them by {late_ms.max():.0f} ms",),
            "other work on the host keeps the loop from waking up on time",
            PATH_OF_LOOP,
        )
    ]


def _slow(facts: RunFacts) -> list[Finding]:
    step_ms = facts.ticks.stages_ms.get("step")
    if step_ms is None or facts.source != "live":
        return []
    p99, beat_ms = float(np.nanpercentile(step_ms, 99)), 1e3 / facts.configuration.loop.rate_hz
    if p99 < SLOW_SHARE * beat_ms:
        return []
    return [
        Finding(
            "slow_filter",
            Severity.INFO,
            f"The filter takes up to {p99:.0f} ms of the {beat_ms:.0f} ms between beats (99 %)",
            (f"median {np.nanmedian(step_ms):.1f} ms",),
            "too many particles or landmarks for this host",
            "lower slam.particles",
        )
    ]


def _storage(facts: RunFacts) -> list[Finding]:
    findings = []
    if facts.gaps:
        ticks, raw = sum(gap.ticks for gap in facts.gaps), sum(gap.raw for gap in facts.gaps)
        at = [facts.seconds(gap.stamp_ns) for gap in facts.gaps]
        findings.append(
            Finding(
                "storage_gap",
                Severity.WARN,
                f"The record lost {ticks} ticks and {raw} raw messages; it continued at {times_text(at)}",
                tuple(dict.fromkeys(gap.reason for gap in facts.gaps))[:3],
                "the disk was full, or slower than the data",
                "free space, or use a faster disk; record.raw = false halves the data",
                tuple((second, second) for second in at),
            )
        )
    if facts.recording:
        findings.append(
            Finding(
                "recording",
                Severity.INFO,
                f"The run is still being recorded: these are its first {facts.duration_s:.0f} s",
                ("what has been written so far is intact, or is being written",),
                "infant run holds the file open",
                "review it again after it has ended",
            )
        )
    elif facts.truncated:
        torn = not any(word in facts.truncated for word in ("damaged record", "damaged chunk", "checksum"))
        findings.append(
            Finding(
                "truncated",
                Severity.WARN,
                "The record ends early" if torn else "The record is damaged",
                (facts.truncated,),
                "the process was killed, or the power failed" if torn else "a disk or a copy changed bytes",
                "no action needed: all complete ticks are used" if torn else "copy the run again, and check the disk",
            )
        )
    return findings


def _failed_steps(facts: RunFacts) -> list[Finding]:
    """Steps of the filter that raised: whatever the pose looks like then follows from them."""
    if not facts.defects:
        return []
    reasons = Counter(reason.partition("; tick ")[0] for _, reason in facts.defects)
    times_s = np.array([time_s for time_s, _ in facts.defects])
    intervals = intervals_where(times_s, np.ones(times_s.size, dtype=np.bool_), 2.0)
    return [
        Finding(
            "defect",
            Severity.ERROR,
            f"The filter has a defect: {times_s.size} of {facts.ticks.times_s.size} steps raised an error "
            f"and lost their scan, during {spans_text(intervals)}",
            tuple(f"{count} times: {reason}" for reason, count in reasons.most_common(3)),
            "a defect of the software",
            "report it, together with the run",
            intervals,
        )
    ]


def _errors(facts: RunFacts) -> list[Finding]:
    """Reports of errors from parts that no other finding looks at; a replay holds those of the drive it was made from,
    whose filter may have failed where this one did not.
    """
    others: tuple[str, ...] = ("laser", "encoders", "health")
    if facts.defects or facts.source != "live":
        others = (*others, "estimator")
    events = [event for event in facts.events if event.severity is Severity.ERROR and event.source not in others]
    if not events:
        return []
    return [
        Finding(
            "reported_errors",
            Severity.ERROR,
            f"{len(events)} errors were reported by {', '.join(sorted({event.source for event in events}))}",
            tuple(event.reason for event in events[:3]),
            "a defect of the software",
            "report it, together with the run",
        )
    ]
