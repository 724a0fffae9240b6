"""Two maps that overlap become one; two that do not stay two."""

from functools import cache

import numpy as np

from slam.maps.joint_map import JointMap, take_map
from slam.pose import Pose2
from slam.relocalise.merge import merge_maps
from tests.slam.relocalise.test_relocaliser import PARK, RADIUS_M, forest
from tests.support.slam.tree_drive import SETTINGS, TreeDrive


@cache
def drive_of(seed: int, turn: float, elsewhere: bool = False) -> tuple[JointMap, TreeDrive]:
    """60 m of the park to the left or to the right from where both begin; the world's frame turned for the second."""
    drive = TreeDrive(seed, forest(31, (0.0, 0.0), 130.0, 220) if elsewhere else PARK)
    drive.truth = Pose2(0.0, 0.0, turn)
    for _ in range(120):
        drive.step(0.5 / RADIUS_M if turn == 0.0 else -0.5 / RADIUS_M)
    return take_map(drive.joint), drive


def test_maps_of_two_drives_are_one_in_the_frame_of_the_first() -> None:
    (first, _), (second, _) = drive_of(1, 0.0), drive_of(2, 2.0)
    merged = merge_maps(SETTINGS, first, second)
    assert merged.joint is not None
    assert merged.found.odds >= 14.0
    assert max(len(first), len(second)) < len(merged.joint) < len(first) + len(second)
    gaps = np.linalg.norm(merged.joint.means_m[:, None] - PARK, axis=2)
    assert np.median(gaps.min(axis=1)) < 0.3
    assert np.percentile(gaps.min(axis=1), 90) < 1.5
    assert len(np.unique(merged.joint.identities)) == len(merged.joint)
    assert merged.joint.scans >= first.scans + second.scans


def test_maps_of_different_places_are_not_merged() -> None:
    merged = merge_maps(SETTINGS, drive_of(1, 0.0)[0], drive_of(2, 2.0, elsewhere=True)[0])
    assert merged.joint is None
    assert merged.found.odds < 14.0


def test_a_mirrored_map_is_not_merged() -> None:
    from dataclasses import replace

    first = drive_of(1, 0.0)[0]
    mirrored = replace(first, means_m=first.means_m * (1.0, -1.0), block_m2=first.block_m2.copy())
    assert merge_maps(SETTINGS, first, mirrored).joint is None
