"""What a drive lacked, as a person reads it."""

from runtime.calibrate.richness import MotionCoverage


def test_too_little_never_reads_like_enough() -> None:
    change = MotionCoverage("change of speed and turning", 2.96, 3.0, "m/s", "start and stop more often")
    assert change.short
    assert change.sentence() == "start and stop more often: change of speed and turning was 2.9 m/s, and 3 are needed"
