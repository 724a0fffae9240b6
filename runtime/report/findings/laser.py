"""What was wrong with the laser: silence, damage, a restart, a low rate, scans that came late, a fast clock."""

import numpy as np

from drivers.measurements import BoolArray, FloatArray, Severity
from runtime.report.facts import RunFacts
from runtime.report.finding import (
    Finding,
    Interval,
    driver_reports,
    intervals_where,
    silences,
    span_text,
    spans_text,
    times_text,
)
from runtime.report.findings.laser_causes import SAID, around, restart_cause, silence_cause
from runtime.report.findings.silence import while_recorded

MISBEHAVES = ("the laser's clock misbehaves", "check laser.stamp_reference and the firmware")
RESTART_S = 0.5  # until the first scan after a restart
SILENT_S = 0.5  # five sweeps at 10 Hz: one or two lost sweeps are not silence
SILENT_PERIODS = 5.0  # the same for slower lasers
SILENT_ERROR_S = 10.0  # as slam.quality calls the pose lost then
LOST_SHARE = 0.05  # of the sweeps; a laser and its cable lose none
EVEN_LEAST, EVEN_SHARE = 5, 0.8  # holes, and their share while there are any, that are a slow motor and no chance
LATE_S = 0.25  # age at the beat; 0.1 s of sweep, at most one beat of waiting, and some of the network's
LATE_SCANS_SHARE = 0.05
OFTEN = 3  # events of a kind; a loaded host or one bit error gives one or two
DRIFT_PPM = 300.0  # a crystal keeps 100 ppm
DRIFT_LEAST_S = 0.02  # apart at the end: a busy host delays even the fastest arrivals by some milliseconds
DRIFT_BENT = 0.15  # of the gain, off the straight line in the middle: a delay that sets in is no drift


def laser_findings(facts: RunFacts) -> list[Finding]:
    """All of them, for runs with a laser."""
    if not facts.scans.are_sweeps:
        return []  # sightings come when something is in view, with gaps and rates of their own
    if facts.imported:
        return _not_recorded(facts)
    return [*_silent(facts), *_damage(facts), *_restarts(facts), *_rate(facts), *_late(facts), *_drift(facts)]


def expected_period_s(facts: RunFacts) -> float:
    """The rate that most sweeps have, but no slower than the beat unless the recording is of another kind."""
    steps = np.diff(facts.scans.times_s)
    usual = float(np.median(steps)) if steps.size else 0.1
    return min(usual, 1.0 / facts.configuration.loop.rate_hz) if facts.source == "live" else usual


def _silent(facts: RunFacts) -> list[Finding]:
    least_s = max(SILENT_S, SILENT_PERIODS * expected_period_s(facts))
    intervals = while_recorded(facts, silences(facts.scans.times_s, facts.duration_s, least_s))
    if not intervals:
        return []
    longest, never = max(end - start for start, end in intervals), not facts.scans.times_s.size
    said = facts.events_ever("laser") if never else around(facts, intervals)
    cause, remedy = silence_cause(facts, intervals, said)
    return [
        Finding(
            "laser_silent",
            Severity.ERROR if never or longest >= SILENT_ERROR_S else Severity.WARN,
            f"The laser sent no usable scan {'in the whole run' if never else f'during {spans_text(intervals)}'}",
            (
                f"none for up to {longest:.1f} s; gaps longer than {least_s:.1f} s count as silence",
                *driver_reports(said),
            ),
            cause,
            remedy,
            intervals,
        )
    ]


def _not_recorded(facts: RunFacts) -> list[Finding]:
    """A recording of others may be thinned or begin late: its holes are no fault of a laser that nobody can mend."""
    least_s = max(SILENT_S, SILENT_PERIODS * expected_period_s(facts))
    intervals = silences(facts.scans.times_s, facts.duration_s, least_s)
    if not intervals:
        return []
    longest = max(end - start for start, end in intervals)
    return [
        Finding(
            "recording_without_scans",
            Severity.INFO,
            f"The recording holds no scans during {spans_text(intervals)}",
            (f"for up to {longest:.1f} s; scans are usually {expected_period_s(facts):.2f} s apart",),
            "the data set was thinned out, or the laser was not recorded then",
            "no action needed: the pose in between is predicted from the wheels",
            intervals,
        )
    ]


def _damage(facts: RunFacts) -> list[Finding]:
    """Damage that came more than once or twice, and ranges that repeat."""
    findings = []
    for kinds, name, title in (
        (("checksum_errors", "framing_errors", "torn_messages"), "laser_checksum", "Laser messages arrived damaged"),
        (("frozen_scans",), "laser_frozen", "The laser kept sending the same ranges"),
    ):
        events = facts.events_of("laser", *kinds)
        if not events:
            continue
        times_s = np.array([facts.seconds(event.stamp_ns) for event in events])
        intervals = intervals_where(times_s, np.ones(len(times_s), dtype=np.bool_), 3.0)
        cause, remedy = SAID[events[0].kind]
        often = len(events) >= OFTEN or name == "laser_frozen"
        severity = Severity.WARN if often else Severity.INFO
        evidence = (f"{len(events)} report{'s' * (len(events) != 1)}, at most one a second", *driver_reports(events, 2))
        findings.append(
            Finding(name, severity, f"{title} during {spans_text(intervals)}", evidence, cause, remedy, intervals)
        )
    return findings


def _most(facts: RunFacts, count: str) -> int:
    """How far a count had grown at the end."""
    values = facts.ticks.counts.get(count, np.zeros(1))
    return int(np.nanmax(values)) if np.isfinite(values).any() else 0


def _restarts(facts: RunFacts) -> list[Finding]:
    events = facts.events_of("laser", "clock_restarts", "stale_stamp", "out_of_order", "future_stamps")
    refusals, ahead = (_most(facts, f"scan_stamps_{why}") for why in ("refused", "ahead_refused"))
    if not events and not refusals and not ahead:
        return []
    times_s = np.array([facts.seconds(event.stamp_ns) for event in events])
    intervals = intervals_where(times_s, np.ones(len(times_s), dtype=np.bool_), 2.0)
    at = f" at {times_text([start for start, _ in intervals])}" if intervals else ""
    stands = any(event.kind == "stale_stamp" for event in events)
    restarted = any(event.kind == "clock_restarts" for event in events) and not stands
    cause, remedy = restart_cause(around(facts, intervals)) if restarted or stands else MISBEHAVES
    said = "the laser or its clock restarted" if restarted else "the stamps stand still or run backwards"
    return [
        Finding(
            "scan_stamps_jump",
            Severity.WARN,
            f"Scan stamps jumped{at}: {said}",
            (
                *((f"the filter refused {refusals} scans because of their stamp",) if refusals else ()),
                *((f"the filter refused {ahead} scans from the future",) if ahead else ()),
                *driver_reports(events),
            ),
            cause,
            remedy,
            _with_silences(facts, intervals),
        )
    ]


def _with_silences(facts: RunFacts, intervals: tuple[Interval, ...]) -> tuple[Interval, ...]:
    """A laser that restarts tells so when it is back: what happened began when it fell silent."""
    quiet = silences(facts.scans.times_s, facts.duration_s, SILENT_S)
    return tuple((min([start, *(s for s, e in quiet if s <= start <= e + RESTART_S)]), end) for start, end in intervals)


def _rate(facts: RunFacts) -> list[Finding]:
    """Sweeps that are missing here and there; long silences are findings of their own."""
    if facts.scans.times_s.size < 20:
        return []
    period_s = expected_period_s(facts)
    steps = np.diff(facts.scans.times_s)
    short = steps < max(SILENT_S, SILENT_PERIODS * period_s)
    missing = np.maximum(np.rint(steps / period_s) - 1.0, 0.0)
    share = float(missing[short].sum() / max(1.0, (steps[short] / period_s).sum()))
    if share < LOST_SHARE:
        return []
    starts = facts.scans.times_s[:-1]
    intervals = intervals_where(starts, short & (missing > 0), 2.0, 1.0)
    arrived = _arrived_share(facts, period_s) > 1.0 - LOST_SHARE
    even = _is_even(starts, steps, short & (missing > 0), period_s)
    rate_hz = float(1.0 / np.mean(steps[short]))
    when = f"during {spans_text(intervals)}" if intervals else "now and then"
    if arrived:
        return [
            Finding(
                "laser_scans_superseded",
                Severity.INFO,
                f"The loop used {rate_hz:.1f} of the laser's {1.0 / period_s:.1f} scans per second: the others came "
                "late, two to a beat",
                (
                    f"ignored {when}",
                    "every sweep arrived; when two came within one beat, the loop used the newer one",
                ),
                "the host or the network was busy and held scans up",
                "run less other work on the host, and connect the laser by its own cable",
                intervals,
            )
        ]
    cause = "the motor turns too slowly, or the laser skips sweeps" if even else "sweeps are lost"
    return [
        Finding(
            "laser_rate_low" if even else "laser_scans_lost",
            Severity.WARN,
            f"The laser sent {rate_hz:.1f} Hz instead of {1.0 / period_s:.1f} Hz: {share:.0%} of the sweeps are lost",
            (f"missing {when}", f"lost at {'even' if even else 'uneven'} intervals"),
            f"{cause}: the network or the host is too busy, there is interference, or the laser is configured that way",
            "connect the laser by its own cable, and let no other program request scans; see laser.url",
            intervals,
        )
    ]


def _is_even(starts: FloatArray, steps: FloatArray, holes: BoolArray, period_s: float) -> bool:
    """Whether the laser leaves out the same number of sweeps each time, for as long as it leaves out any."""
    for start, end in intervals_where(starts, holes, 2.0, 1.0):
        within = (starts >= start) & (starts <= end)
        periods = np.rint(steps[within] / period_s)
        even = float(np.mean(periods == np.median(periods))) >= EVEN_SHARE
        if even and np.count_nonzero(within & holes) >= EVEN_LEAST:
            return True
    return False


def _arrived_share(facts: RunFacts, period_s: float) -> float:
    """Sweeps that came over the wire, of those that should have; 0 where the bytes were not recorded."""
    arrival = facts.device_clock.arrival_s
    return float((arrival.size - 1) * period_s / (arrival[-1] - arrival[0])) if arrival.size > 20 else 0.0


def _late(facts: RunFacts) -> list[Finding]:
    if facts.source != "live" or facts.scans.age_s.size < 20:
        return []
    late = facts.scans.age_s > LATE_S
    share = float(late.mean())
    events = facts.events_of("laser", "late_scans")
    if share < LATE_SCANS_SHARE and len(events) < OFTEN:
        return []
    intervals = intervals_where(facts.scans.times_s, late, 2.0)
    middle_s, most_s = np.percentile(facts.scans.age_s, (50.0, 99.0))
    return [
        Finding(
            "laser_late",
            Severity.WARN if share >= LATE_SCANS_SHARE else Severity.INFO,
            f"Scans arrived late: {share:.0%} of them were older than {LATE_S * 1e3:.0f} ms at their beat",
            (f"median age {middle_s * 1e3:.0f} ms, 99 % {most_s * 1e3:.0f} ms", *driver_reports(events)),
            "the network or the host delays them; the pose in between is predicted from the wheels",
            "connect the laser by its own cable; raise loop.priority so that other work on the host has to wait",
            intervals,
        )
    ]


def _drift(facts: RunFacts) -> list[Finding]:
    """Device against host by the fastest arrivals of the first and last fifth: delays only ever add."""
    arrival, device = facts.device_clock.arrival_s, facts.device_clock.device_s
    if arrival.size < 50 or (np.diff(device) < 0.0).any():
        return []  # a clock that restarted has no drift
    fifth = arrival.size // 5
    delay = arrival - device
    first, last = int(np.argmin(delay[:fifth])), arrival.size - fifth + int(np.argmin(delay[-fifth:]))
    ahead_s = float(delay[first] - delay[last])
    ppm = ahead_s / float(arrival[last] - arrival[first]) * 1e6
    middle = 2 * fifth + int(np.argmin(delay[2 * fifth : 3 * fifth]))
    share = float((arrival[middle] - arrival[first]) / (arrival[last] - arrival[first]))
    steady = abs(float(delay[first] - delay[middle]) - share * ahead_s) < DRIFT_BENT * abs(ahead_s)
    if abs(ppm) < DRIFT_PPM or abs(ahead_s) < DRIFT_LEAST_S or not steady:
        return []
    measured = (float(arrival[first]), float(arrival[last]))
    return [
        Finding(
            "laser_clock_drift",
            Severity.WARN,
            f"The laser's clock runs {abs(ppm):.0f} ppm {'fast' if ppm > 0 else 'slow'}",
            (
                f"it gained {ahead_s * 1e3:+.0f} ms on the host during {span_text(measured)}; a good "
                "crystal stays within 100 ppm",
            ),
            "a worn or cold oscillator in the laser, or the host's clock is being slewed",
            "no action needed now: the driver follows; check the time service of the host if all devices drift",
        )
    ]
