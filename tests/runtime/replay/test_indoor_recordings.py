"""Indoor recordings with scans seconds apart, against what is known of their truth."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from runtime.evaluate.evaluate import against_data_set
from runtime.importers.archive import load_archive
from runtime.importers.data_set import SLOW_SPACING_NS, configuration_path
from runtime.importers.sightings import seen
from runtime.importers.ticks import ticks
from runtime.importers.truth import truth_of
from runtime.importers.wheel_streams import wheel_samples
from runtime.record.trajectories import Trajectories
from runtime.settings.configuration import load_configuration
from slam.estimator import Estimator


def figures_of(folder: Path, scans: int) -> dict[str, float]:
    """What evaluate says of the estimates over the first scans of a set."""
    archive = load_archive(folder)
    slam = load_configuration(configuration_path(archive)).slam
    estimator, rows, counted = Estimator(slam, 1), [], 0
    for tick in ticks(seen(archive), wheel_samples(archive), SLOW_SPACING_NS):
        estimate = estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
        poses = (estimate.map_from_body, estimate.particle_mean, estimate.odom_from_body)
        rows.append([(tick.stamp_ns * 1e-9, pose.x_m, pose.y_m, pose.heading_rad) for pose in poses])
        counted += tick.scan is not None
        if counted == scans:
            break
    columns = np.array(rows).transpose(1, 0, 2)
    truth = truth_of(archive)
    assert truth is not None
    mount = slam.mount
    trajectories = Trajectories(columns[0], columns[1], columns[2], None)
    return against_data_set(trajectories, truth, (mount.x_m, mount.y_m, mount.yaw_rad))


def test_the_first_rooms_of_intel_keep_their_shape(recorded_data: Callable[[str], Path]) -> None:
    figures = figures_of(recorded_data("intel_lab"), 150)
    assert figures["relations"] > 100
    assert figures["odometry_relation_translation_m"] > 3.0 * figures["relation_translation_m"]
    assert figures["relation_translation_m"] < 0.2
    assert figures["relation_rotation_deg"] < 5.0


@pytest.mark.bench
def test_all_of_intel_keeps_its_shape(recorded_data: Callable[[str], Path]) -> None:
    figures = figures_of(recorded_data("intel_lab"), 910)
    assert figures["relations"] > 2400
    assert figures["relation_translation_m"] < 1.0
    assert figures["relation_rotation_deg"] < 10.0


@pytest.mark.bench
def test_aces_comes_out_better_than_its_wheels(recorded_data: Callable[[str], Path]) -> None:
    figures = figures_of(recorded_data("aces_austin"), 440)
    assert figures["rms_m"] < 0.5 * figures["odometry_rms_m"]
