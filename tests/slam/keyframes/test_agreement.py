import pytest

from slam.keyframes.agreement import Agreement, correction_of
from slam.pose import Pose2

POSE = Pose2(12.0, -7.0, 2.0)
CORRECTION = Pose2(0.3, 0.2, 0.05)


def test_a_correction_moves_the_pose_to_where_the_keyframe_saw_the_body() -> None:
    keyframe, found = Pose2(10.0, -8.0, 1.7), Pose2(1.4, 1.1, 0.4)
    moved = correction_of(POSE, keyframe.inverse() @ POSE, found) @ POSE
    assert moved.as_array() == pytest.approx((keyframe @ found).as_array())


@pytest.mark.parametrize(
    ("number", "further", "agrees"),
    [
        (4, Pose2(), True),
        (4, Pose2(0.2, 0.1, 0.05), True),
        (3, Pose2(), False),  # the same keyframe again is no second voice
        (4, Pose2(0.4, 0.0, 0.0), False),
        (4, Pose2(0.0, 0.0, 0.2), False),
    ],
)
def test_two_keyframes_agree_where_they_name_nearly_the_same_place(number: int, further: Pose2, agrees: bool) -> None:
    """What they say is compared at the pose, however far from the map's origin it is."""
    agreement = Agreement()
    assert not agreement.confirms(3, CORRECTION, POSE)
    said = CORRECTION @ POSE @ further @ POSE.inverse()
    assert agreement.confirms(number, said, POSE) is agrees
    assert (agreement.said_before is None) is agrees
