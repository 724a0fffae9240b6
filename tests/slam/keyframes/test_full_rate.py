"""Keyframes where scans come ten times a second."""

import numpy as np
import pytest

from drivers.measurements import FloatArray, ScanLike
from drivers.simulated.world.places.building import Building, building_settings
from runtime.studies.places.building_drive import building_ticks
from slam.estimator import Estimator
from slam.front_end.alignment import Alignment
from slam.front_end.wide_search import Known
from slam.observations import FeatureRows
from slam.odometry.odometry import Increment
from slam.particles.fastslam import FastSlam, ScanOutcome
from slam.settings.slam import SlamSettings
from slam.visibility import SightLine


def test_the_particles_do_not_take_what_a_keyframe_says_of_the_joint_gaussians_older_errors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each has errors of its own: with the correction of the other, particles in a park were 0.64 m off."""
    measured: list[FloatArray] = []
    taken: list[FloatArray] = []
    refine, step = Alignment.refine, FastSlam.step

    def refined(alignment: Alignment, scan: ScanLike, increment: Increment, known: Known) -> Increment:
        better = refine(alignment, scan, increment, known)
        measured.append(better.mean)
        return better

    def stepped(particles: FastSlam, increment: Increment, rows: FeatureRows, sight: SightLine) -> ScanOutcome:
        taken.append(increment.mean)
        return step(particles, increment, rows, sight)

    monkeypatch.setattr(Alignment, "refine", refined)
    monkeypatch.setattr(FastSlam, "step", stepped)
    building = Building(building_settings(3, 1081))
    mount_x_m, _, _ = building.settings.laser.body_from_laser
    estimator = Estimator(SlamSettings.model_validate({"mount": {"x_m": mount_x_m}, "particles": 5}), 3)
    counts: dict[str, float] = {}
    for tick in building_ticks(building, 10.0, 0.1):
        counts |= estimator.step(tick.stamp_ns, tick.scan, tick.wheels).counts
    assert counts["keyframe_fits"] > 15
    assert counts["scans_aligned"] == 0
    np.testing.assert_array_equal(np.array(taken), np.array(measured))
