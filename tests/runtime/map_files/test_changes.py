"""What has gone and what is new, from the saved map and what a run published last."""

import numpy as np

from drivers.measurements import Severity
from runtime.map_files.changes import map_changes
from runtime.report.findings.map import changes_findings, evidence
from slam.estimate import LandmarkMap
from tests.support.runtime.small_maps import small_map

KNOWN = small_map().landmarks


def published(gone: list[int], missed: list[int], new_log_odds: list[float]) -> LandmarkMap:
    kept = np.setdiff1d(np.arange(len(KNOWN.identities)), gone)
    log_odds = np.where(np.isin(kept, missed), -4.0, KNOWN.existence_log_odds[kept])
    new = len(new_log_odds)
    return LandmarkMap(
        np.concatenate((KNOWN.identities[kept], 10**9 + np.arange(new))),
        np.concatenate((KNOWN.means_m[kept], np.full((new, 2), 7.0))),
        np.concatenate((KNOWN.covariances_m2[kept], np.tile(np.eye(2), (new, 1, 1)))),
        np.concatenate((log_odds, new_log_odds)),
    )


def test_nothing_has_changed_where_everything_stands() -> None:
    changes = map_changes(KNOWN, published([], [], []))
    assert (len(changes.gone_m), len(changes.new_m)) == (0, 0)
    assert evidence(changes) == ()


def test_removed_and_missed_landmarks_are_gone_and_confirmed_ones_new() -> None:
    changes = map_changes(KNOWN, published([3, 5], [8], [3.5, 1.0]))
    assert np.array_equal(changes.gone_m, KNOWN.means_m[[3, 5, 8]])
    assert np.array_equal(changes.new_m, [[7.0, 7.0]])
    gone, new = evidence(changes)
    assert gone.count("(") == 3
    assert new == "new at (7.0, 7.0)"


def test_a_map_of_which_much_is_gone_is_something_to_look_at() -> None:
    known = len(KNOWN.identities)
    (finding,) = changes_findings(map_changes(KNOWN, published(list(range(15)), [], [])), known)
    assert finding.severity is Severity.WARN
    assert "15 landmarks are gone, 0 are new" in finding.title
    (finding,) = changes_findings(map_changes(KNOWN, published([1], [], [])), known)
    assert finding.severity is Severity.INFO
    assert changes_findings(map_changes(KNOWN, KNOWN), known) == []
