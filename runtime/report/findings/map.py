"""What stands no longer where the saved map of a run has it, and what is new."""

import numpy as np

from drivers.measurements import Severity
from runtime.map_files.changes import MapChanges, map_changes
from runtime.report.facts import RunFacts
from runtime.report.finding import Finding

MOST_NAMED = 5  # places in the evidence; the maps have them all
GRAVE_SHARE = 0.3  # of a map; with half of it exchanged a place is still recognised, but later


def map_findings(facts: RunFacts) -> list[Finding]:
    """At most one."""
    if facts.known_map is None or facts.landmarks is None:
        return []
    return changes_findings(map_changes(facts.known_map, facts.landmarks), len(facts.known_map.identities))


def changes_findings(changes: MapChanges, known: int) -> list[Finding]:
    """known: landmarks of the saved map."""
    gone, new = len(changes.gone_m), len(changes.new_m)
    if not gone and not new:
        return []
    return [
        Finding(
            "map_changed",
            Severity.WARN if gone > GRAVE_SHARE * known else Severity.INFO,
            f"The place differs from the saved map: {gone} landmarks are gone, {new} are new",
            evidence(changes),
            "things were moved since the map was made, or landmarks in it were people and parked vehicles",
            "no action needed while the pose is good; a run with --map and without --localise-only writes "
            "an updated map",
        )
    ]


def evidence(changes: MapChanges) -> tuple[str, ...]:
    """Where the first of them are."""
    return tuple(
        f"{word} at " + ", ".join(f"({x:.1f}, {y:.1f})" for x, y in points[:MOST_NAMED])
        for word, points in (("gone", changes.gone_m), ("new", changes.new_m))
        if np.size(points)
    )
