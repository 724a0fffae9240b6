import numpy as np

from slam.joint.atlas import Atlas
from tests.support.slam.python_calls import calls_in


def atlas_of(landmarks: int) -> Atlas:
    """Landmarks outside the state, two in each cell."""
    atlas = Atlas(10.0)
    for number in range(landmarks):
        atlas.add_away(4096 + number, 5.0, np.array((5.0 * number, 1.0)), np.eye(2))
    return atlas


def test_a_copy_is_made_in_as_many_calls_whatever_the_map_holds() -> None:
    """Of 20 000 landmarks it took 20 ms, every ten scans, while the loop waited."""
    assert calls_in(atlas_of(3000).copied) == calls_in(atlas_of(300).copied)


def test_what_happens_to_an_atlas_is_not_seen_in_its_copy() -> None:
    atlas = atlas_of(6)
    copied = atlas.copied()
    near = copied.away_near(0.0, 0.0, 100.0)
    atlas.take_back(near[0], 0)
    atlas.add_away(1, 5.0, np.array((1.0, 1.0)), np.eye(2))
    assert copied.away_near(0.0, 0.0, 100.0) == near == atlas_of(6).away_near(0.0, 0.0, 100.0)
    copied.take_back(near[2], 0)
    assert near[2] in atlas.away_near(0.0, 0.0, 100.0)
    assert len(atlas.away_near(0.0, 0.0, 100.0)) == 6
