"""What the path, smoothed by the whole run, refutes of what the filter did while it drove."""

from drivers.measurements import Severity
from runtime.report.facts import RunFacts
from runtime.report.finding import Finding, spans_text, times_text

SHOWN = 5  # of each kind, as evidence
MANY_SIGMAS = 5.0  # of a parting: the pose was not where its covariance said


def smoothed_findings(facts: RunFacts) -> list[Finding]:
    """Wrong matches, times when filter and smoothed path part, landmarks that are one; none without `infant smooth`."""
    return [*_wrong_matches(facts), *_partings(facts), *_doubled(facts)]


def _wrong_matches(facts: RunFacts) -> list[Finding]:
    matches = () if facts.smoothed is None else facts.smoothed.wrong_matches
    if not matches:
        return []
    first = matches[0]
    times = times_text([match.start_s for match in matches], SHOWN)
    title = f"A wrong match at {times}" if len(matches) == 1 else f"Wrong matches at {times}"
    return [
        Finding(
            kind="wrong_matches",
            severity=Severity.WARN,
            title=title,
            evidence=tuple(
                f"{match.start_s:.0f} s: {match.sightings} sightings taken for landmark {match.landmark}, up to "
                f"{match.off_m:.2f} m from it"
                for match in matches[:SHOWN]
            ),
            cause=f"something up to {first.off_m:.1f} m from landmark {first.landmark} was taken for it: a "
            "moving object, an object next to it, or a pose that was off",
            remedy="look at those times with infant view; the smoothed path does not use these matches",
            intervals=tuple((match.start_s, match.end_s) for match in matches),
        )
    ]


def _partings(facts: RunFacts) -> list[Finding]:
    partings = () if facts.smoothed is None else facts.smoothed.partings
    if not partings:
        return []
    worst = partings[0]
    spans = tuple((parting.start_s, parting.end_s) for parting in partings)
    return [
        Finding(
            kind="parted_from_smoothed",
            severity=Severity.WARN if worst.sigmas >= MANY_SIGMAS else Severity.INFO,
            title=f"The pose was more than three sigma from the smoothed path in {spans_text(spans)}",
            evidence=tuple(
                f"{spans_text((span,))}: up to {parting.apart_m:.2f} m, {parting.sigmas:.1f} sigma"
                for span, parting in zip(spans[:SHOWN], partings, strict=False)
            ),
            cause="the filter was too sure of itself; later scans show that the rover was elsewhere",
            remedy="see which wrong match or slip begins there; use smoothed.tum instead of the published path",
            intervals=spans,
        )
    ]


def _doubled(facts: RunFacts) -> list[Finding]:
    pairs = () if facts.smoothed is None else facts.smoothed.doubled
    if not pairs:
        return []
    number = "One pair" if len(pairs) == 1 else f"{len(pairs)} pairs"
    return [
        Finding(
            kind="landmarks_doubled",
            severity=Severity.INFO,
            title=f"{number} of landmarks in the map probably stand for one object each",
            evidence=tuple(
                f"{pair.first} and {pair.second}, {pair.apart_m:.2f} m apart at ({pair.x_m:.1f}, {pair.y_m:.1f}) m"
                for pair in pairs[:SHOWN]
            ),
            cause="the rover came back with a pose that was off by more than the gates and mapped them again",
            remedy="no action needed for the pose; before infant map save, drive the place once more",
        )
    ]
