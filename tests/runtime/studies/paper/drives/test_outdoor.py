import numpy as np

from runtime.studies.paper.drives.outdoor import (
    ROBOT_RADIUS_M,
    in_front_of_robots,
    mounted,
    outdoor_steps,
    robots_m,
    world_settings,
)
from runtime.studies.paper.drives.outdoor_drive import outdoor_drive


def test_beams_on_a_robot_end_on_its_hull_and_no_beam_gets_longer() -> None:
    settings = world_settings(1)
    bearings = np.linspace(-2.3, 2.3, 1081)
    far, pose = np.full(1081, 29.0), np.zeros(3)
    ranges, on_robot = in_front_of_robots(far, bearings, pose, 0, settings)
    assert on_robot.any()
    assert (ranges <= far).all()
    x, y, heading = mounted(pose, settings.laser.body_from_laser)
    angles = bearings[on_robot] + heading
    points = np.column_stack((x + ranges[on_robot] * np.cos(angles), y + ranges[on_robot] * np.sin(angles)))
    distances = np.hypot(*(points[:, np.newaxis] - robots_m(settings, 0)).transpose(2, 0, 1)).min(axis=1)
    np.testing.assert_allclose(distances, ROBOT_RADIUS_M, atol=1e-9)


def test_an_outdoor_drive_keeps_features_apart_and_beats_odometry() -> None:
    figures = outdoor_drive(1, "proposed", 5, 12.0, True, "test")
    assert figures["least_spacing_m"] >= 0.0995
    assert figures["published_largest_m"] < figures["odometry_largest_m"]
    assert figures["moving_created_share"] < figures["moving_features_share"]
    assert len(figures["paths"]["truth"]) == len(outdoor_steps(1, 12.0))
