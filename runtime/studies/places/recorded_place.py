"""One drive through a recording, with the set's own file or with the defaults."""

from pathlib import Path

import numpy as np

from drivers.measurements import OdometryPose
from runtime.importers.data_set import FAST_SPACING_NS, SLOW_SPACING_NS
from runtime.importers.sightings import seen
from runtime.importers.ticks import ticks
from runtime.importers.truth import truth_of
from runtime.importers.wheel_streams import wheel_samples
from runtime.studies.jobs import Result
from runtime.studies.paper.drives.recorded_drive import thinned
from runtime.studies.places.drive import driven
from runtime.studies.places.figures import occupied_cells, truth_figures
from runtime.studies.places.recordings import archive_of, prepared
from slam.estimate import Quality
from slam.estimator import Estimator

LEAVING_STREAM = 5  # second word of the seed, as in the study of the paper: the same scans are left out


def recorded_place(
    data: str,
    name: str,
    own: bool,
    left_out: float,
    seed: int,
    code: str,  # noqa: ARG001  names the job
    digest: str,  # noqa: ARG001  the same for the archive
) -> Result:
    """Figures of the set `name` of the folder `data`; left_out: share of scans left out at random, drawn from seed.

    Where nothing is known of the truth, the occupied cells of the map say how crisp it is. Raises DataSetError,
    ConfigurationError.
    """
    archive, configuration = prepared(archive_of(Path(data), name), own)
    mount = configuration.slam.mount
    body_from_laser = (mount.x_m, mount.y_m, mount.yaw_rad)
    scans = list(thinned(seen(archive), left_out, np.random.default_rng([seed, LEAVING_STREAM])))
    wheels = wheel_samples(archive, configuration.vehicle)
    spacing_ns = SLOW_SPACING_NS if isinstance(wheels[0], OdometryPose) else FAST_SPACING_NS
    drive = driven(Estimator(configuration.slam, configuration.seed), ticks(scans, wheels, spacing_ns))
    result: Result = {
        "scans": len(scans),
        "way_m": float(np.hypot(*np.diff(drive.odometry[:, 1:3], axis=0).T).sum()),
        "landmarks": drive.landmarks,
        "defects": drive.defects,
        "lost": drive.share_of(Quality.LOST),
        "cpu_s": float(drive.step_s.sum()),
    }
    truth = truth_of(archive)
    if truth is not None:
        return result | truth_figures(drive, truth, body_from_laser)
    cells = {
        whose: occupied_cells(map(mount.upright, scans), path, body_from_laser)
        for whose, path in (("published", drive.published), ("odometry", drive.odometry))
    }
    result |= {f"{whose}_cells": count for whose, count in cells.items()}
    return result | {"cells_over_odometry": cells["published"] / max(cells["odometry"], 1)}
