"""Whether the pose could be believed, what moved around the rover, and how far off the pose was."""

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import Severity
from runtime.report.facts import QUALITIES, RunFacts
from runtime.report.finding import Finding, Interval, intervals_where, silences, spans_text
from runtime.report.findings.searching import is_never_found, searched_until_s

UNCERTAIN_GAP_M = 1.5  # as slam.quality has it, which tests hold it to: to import that loads a compiler, 45 MB
STARTING_S = 2.0  # before the first scans nothing is known, and that is no fault
BLIND_SCANS_S = 1.0  # of silence put a pose in doubt
FLAPPING_S = 2.0  # doubts with shorter breaks between them are one
BEFORE_LOST_S = 3.0  # a pose is doubted for so long before it counts as lost
UNCERTAIN_S = 1.0  # shorter doubts pass with the next landmarks
JUMP_M = 0.5  # in one beat beyond what the wheels say; a rover at 0.5 m/s moves 0.05
JUMP_SIGMAS = 5.0
BLIND_S = 10.0  # without any match; a bend around a bare building takes as long
PEOPLE_SHARE = 0.05  # of the returns; an empty park stays below 0.04 (two worlds, 23 s each), seven people give 0.15
PEOPLE_S = 1.0
WORSE_FACTOR = 2.0
WORSE_M = 0.2
BELIEVED_SIGMAS = 5.0  # a pose whose error is this many times what it says of itself
BELIEVED_M = 0.3  # smaller errors may be those of the truth
DOUBTED_M = 0.2  # standard deviation; a smaller one hinders nobody
MOST_LOST = 0.05  # of a run whose error is that of its best 95 %


def pose_findings(facts: RunFacts) -> list[Finding]:
    """All of them."""
    told = [*_quality(facts), *_jumps(facts), *_unmatched(facts), *_people(facts)]
    return told if is_never_found(facts) else [*told, *_accuracy(facts), *_belief(facts)]


def _quality(facts: RunFacts) -> list[Finding]:
    ticks, findings = facts.ticks, []
    late = ticks.times_s > max(STARTING_S, searched_until_s(facts))
    for word, severity, least_s in (("uncertain", Severity.WARN, UNCERTAIN_S), ("lost", Severity.ERROR, 0.0)):
        holds = (ticks.quality == QUALITIES.index(word)) & late
        intervals = intervals_where(ticks.times_s, holds, FLAPPING_S, least_s)
        share = float(holds.mean())
        if not intervals or (word == "uncertain" and not _stands_alone(facts, intervals)):
            continue
        inside = holds & np.isfinite(ticks.position_sd_m)
        cause, remedy = _doubt(facts, holds, intervals)
        if facts.imported and _blind(facts, intervals):  # a hole of the recording is no fault of the rover
            severity = Severity.WARN if word == "lost" else Severity.INFO
        findings.append(
            Finding(
                f"pose_{word}",
                severity,
                f"The pose was {word} for {share * facts.duration_s:.1f} s, {share:.0%} of the run: "
                f"{spans_text(intervals)}",
                (
                    f"standard deviation up to {min(ticks.position_sd_m[inside].max(), 1e6):.2f} m; the two estimators "
                    f"were up to {ticks.apart_m[inside].max():.2f} m apart",
                ),
                cause,
                remedy,
                intervals,
            )
        )
    return findings


def _stands_alone(facts: RunFacts, intervals: tuple[Interval, ...]) -> bool:
    """Whether a doubt was more than the way into being lost and out of it."""
    lost_s = facts.ticks.times_s[facts.ticks.quality == QUALITIES.index("lost")]
    edges = [((lost_s >= start - FLAPPING_S) & (lost_s <= end + FLAPPING_S)).any() for start, end in intervals]
    return any(not edge or end - start > BEFORE_LOST_S for edge, (start, end) in zip(edges, intervals, strict=True))


def _doubt(facts: RunFacts, holds: NDArray[np.bool_], intervals: tuple[Interval, ...]) -> tuple[str, str]:
    """Cause and remedy by which bound of slam.quality was passed for most of the time."""
    quality, ticks = facts.configuration.slam.quality, facts.ticks
    if _blind(facts, intervals):
        if not facts.scans.are_sweeps:
            return (
                "no landmark was sighted",
                "put up landmarks, such as posts: without them the pose is dead reckoning",
            )
        if facts.imported:
            return "the recording holds no scans then", "no action needed: the pose is dead reckoning there"
        return "no scans came", "find out why there were no scans"
    if np.median(ticks.apart_m[holds]) > UNCERTAIN_GAP_M:
        return (
            "the particles have drifted from the joint Gaussian, whose pose is published and may still be right",
            "raise slam.particles; look at what happened at that time",
        )
    score = ticks.counts.get("doubt_score")
    if facts.began_with_one_scan(intervals[0]):
        return (
            "the rover was carried, pushed or lifted: a scan fits nowhere near the one before",
            "find out what happened to it at that time; drive on, or tell it where it is",
        )
    if score is not None and np.nanmedian(score[holds]) >= 0.5 * quality.lost_score:
        return (
            "landmarks of the map are not where they should be: the rover was carried or slipped, or a match was wrong",
            "drive back to where the pose was good; look at what happened when it was lost",
        )
    return (
        "too few landmarks are in view, or matches contradict each other",
        "raise slam.particles; put up landmarks, such as posts",
    )


def _blind(facts: RunFacts, intervals: tuple[Interval, ...]) -> bool:
    """Whether most of them fall together with a time without scans."""
    scanless = silences(facts.scans.times_s, facts.duration_s, BLIND_SCANS_S)
    blind = [any(a <= end and b >= start for a, b in scanless) for start, end in intervals]
    return 2 * sum(blind) >= len(blind)


def _jumps(facts: RunFacts) -> list[Finding]:
    """Steps of the published pose that the wheels do not explain."""
    ticks = facts.ticks
    if ticks.times_s.size < 3:
        return []
    ways = [np.hypot(*np.diff(poses[:, :2], axis=0).T) for poses in (ticks.estimated, ticks.odometry)]
    beyond = np.maximum(JUMP_M, JUMP_SIGMAS * ticks.position_sd_m[1:])
    holds = (ways[0] - ways[1] > beyond) & (ticks.times_s[1:] > STARTING_S)
    holds &= ~np.isfinite(ticks.counts.get("recognised_map_id", np.full(len(holds) + 1, np.nan))[1:])
    if not holds.any():
        return []
    intervals = intervals_where(ticks.times_s[1:], holds, 0.5)
    return [
        Finding(
            "pose_jumps",
            Severity.WARN,
            f"The pose jumped by up to {(ways[0] - ways[1])[holds].max():.1f} m during {spans_text(intervals)}",
            (f"{int(holds.sum())} steps beyond {JUMP_M} m and {JUMP_SIGMAS:.0f} standard deviations",),
            "a wrong match was corrected, or the wheels slipped or fell silent",
            "raise slam.particles; see the findings about the wheels",
            intervals,
        )
    ]


def _unmatched(facts: RunFacts) -> list[Finding]:
    matched = facts.ticks.counts.get("matched")
    if matched is None:
        return []
    seen = np.isfinite(matched) & (facts.ticks.times_s > 5.0)
    times_s = facts.ticks.times_s[seen]
    if not times_s.size:
        return []
    intervals = intervals_where(times_s, matched[seen] == 0, 0.35, BLIND_S)
    if not intervals:
        return []
    return [
        Finding(
            "no_landmarks",
            Severity.WARN,
            f"No landmark was matched during {spans_text(intervals)}",
            ("the pose is dead reckoning there",),
            "nothing that stands still is in view, or the front end rejects it",
            "let slam.front_end accept more features, or choose another course",
            intervals,
        )
    ]


def _people(facts: RunFacts) -> list[Finding]:
    """While the pose is believed: where it is wrong, everything stands where nothing was before."""
    moved = np.where(_tracked(facts), np.nan_to_num(facts.scans.near_moved_share), 0.0)
    intervals = intervals_where(facts.scans.times_s, moved > PEOPLE_SHARE, 2.0, PEOPLE_S)
    if not intervals:
        return []
    evidence = (f"up to {moved.max():.0%} of the returns were close and fell where nothing was before",)
    remedy = "no action needed: they are not used as landmarks (slam.techniques.difference)"
    if facts.imported:  # indoors, and where scans are seconds apart, more comes into view than moves
        title = f"Things moved or came into view near the laser during {spans_text(intervals)}"
        cause = "people, or objects behind corners that appear between infrequent scans"
        return [Finding("movement", Severity.INFO, title, evidence, cause, remedy, intervals)]
    title, cause = f"People walked by during {spans_text(intervals)}", "people, or other things that move"
    return [Finding("people", Severity.INFO, title, evidence, cause, remedy, intervals)]


def _tracked(facts: RunFacts) -> NDArray[np.bool_]:
    """(scans,) whether the pose was neither lost nor in doubt at the beat that used the scan."""
    ticks = facts.ticks
    beats = np.searchsorted(ticks.times_s, facts.scans.times_s + facts.scans.age_s - 1e-6)
    quality = ticks.quality[np.minimum(beats, ticks.quality.size - 1)]
    believed: NDArray[np.bool_] = quality < QUALITIES.index("uncertain")
    return believed


def _accuracy(facts: RunFacts) -> list[Finding]:
    slam_m, odometry_m = facts.accuracy.get("rms_m"), facts.accuracy.get("odometry_rms_m")
    if slam_m is None or odometry_m is None or slam_m < WORSE_FACTOR * odometry_m + WORSE_M:
        return []
    return [
        Finding(
            "worse_than_odometry",
            Severity.WARN,
            f"The pose is farther from the truth ({slam_m:.2f} m RMS) than odometry alone ({odometry_m:.2f} m)",
            (f"truth: {facts.accuracy['truth']}",),
            "wrong matches, or a wrong mount of the laser",
            "check slam.mount; raise slam.particles",
        )
    ]


def _belief(facts: RunFacts) -> list[Finding]:
    """The error against the standard deviation that was published while the pose was believed."""
    error_m = facts.accuracy.get("trimmed_rms_m", facts.accuracy.get("rms_m"))
    believed = (facts.ticks.quality == QUALITIES.index("tracking")) & np.isfinite(facts.ticks.position_sd_m)
    lost_share = np.mean(facts.ticks.quality == QUALITIES.index("lost"))
    if error_m is None or not believed.any() or lost_share > MOST_LOST:  # while it is lost it claims nothing
        return []
    claimed_m = float(np.sqrt(np.mean(facts.ticks.position_sd_m[believed] ** 2)))
    truth = f"truth: {facts.accuracy['truth']}"
    if claimed_m > max(DOUBTED_M, BELIEVED_SIGMAS * error_m):
        return [
            Finding(
                "underconfident",
                Severity.WARN,
                f"The pose claims a standard deviation of {claimed_m:.2f} m but is only {error_m:.2f} m off (RMS)",
                (truth,),
                "the configured noise is too large, or the map began while the pose was already uncertain",
                "lower the noise of slam.odometry to what infant calibrate finds; look at sigma at the start",
            )
        ]
    if error_m < max(BELIEVED_M, BELIEVED_SIGMAS * claimed_m):
        return []
    return [
        Finding(
            "overconfident",
            Severity.WARN,
            f"The pose is {error_m:.2f} m off (RMS) but claims a standard deviation of {claimed_m:.2f} m",
            (truth, f"{error_m / max(claimed_m, 1e-9):.0f} standard deviations"),
            "a wrong match that nothing has contradicted since, or the configured noise is too small",
            "raise the sigmas of slam.front_end and the noise of slam.odometry; see where the error begins",
        )
    ]
