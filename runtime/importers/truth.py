"""What a data set knows of the truth, kept inside the run so that evaluating it needs nothing else."""

import numpy as np

from runtime.evaluate.truth import DataSetTruth
from runtime.importers.archive import Archive
from runtime.importers.sightings import UNKNOWN


def truth_of(archive: Archive) -> DataSetTruth | None:
    """The truth in an archive, None when there is none."""
    start_s = archive.start_s
    fixes = poses = relations = landmarks = None
    if "gt_xy" in archive and "gt_t" in archive:
        times_s = archive["gt_t"] - start_s
        if "gt_theta" in archive:
            poses = np.column_stack((times_s, archive["gt_xy"], archive["gt_theta"]))
        else:
            good = archive["gt_good"] if "gt_good" in archive else np.ones(len(times_s), bool)
            fixes = np.column_stack((times_s, archive["gt_xy"]))[good.astype(bool)]
    if "rel" in archive:
        rows = archive["rel"]
        relations = np.column_stack((rows[:, :2] - start_s, rows[:, 2:4], rows[:, 7]))
    if "landmarks" in archive:
        count = len(archive["landmarks"])
        identities = archive["landmark_id"] if "landmark_id" in archive else np.full(count, UNKNOWN)
        landmarks = np.column_stack((identities.astype(np.float64), archive["landmarks"]))
    if all(part is None for part in (fixes, poses, relations, landmarks)):
        return None
    kind = str(archive.meta.get("gt_kind", ""))
    return DataSetTruth(fixes, poses, kind, relations, landmarks, of_body="robot centre" in kind.lower())
