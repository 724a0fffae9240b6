"""How far the wheels can be believed is learnt from scans."""

import numpy as np

from slam.odometry.trust import LARGEST_RATIO, WheelTrust

CLAIMED = np.diag((1e-4, 1e-4, 1e-6))
EXACT = 0.01 * CLAIMED


def after(deviations: float, scans: int) -> WheelTrust:
    """Scans whose alignment is off the wheels' motion by so many of the claimed deviations, to either side."""
    trust = WheelTrust()
    for scan in range(scans):
        prior = trust.scaled(CLAIMED)
        off = deviations * np.sqrt(np.diag(CLAIMED)) * (1.0 if scan % 2 else -1.0)
        trust.compare(off, prior, EXACT)
    return trust


def test_wheels_that_err_ten_times_more_than_they_claim_are_found_out() -> None:
    factor = np.diag(after(10.0, 200).scaled(CLAIMED)) / np.diag(CLAIMED)
    assert (np.abs(factor / 100.0 - 1.0) < 0.05).all()


def test_wheels_that_are_better_than_they_claim_are_not_believed_more() -> None:
    assert np.array_equal(after(0.1, 200).scaled(CLAIMED), CLAIMED)


def test_one_outlier_says_no_more_than_three_deviations() -> None:
    one, many = WheelTrust(), WheelTrust()
    one.compare(np.array((1.0, 1.0, 1.0)), CLAIMED, EXACT)
    many.compare(np.array((1e6, 1e6, 1e6)), CLAIMED, EXACT)
    assert np.array_equal(one.scaled(CLAIMED), many.scaled(CLAIMED))
    assert np.diag(one.scaled(CLAIMED) / CLAIMED.max()).max() < LARGEST_RATIO


def test_an_alignment_that_knows_no_more_than_the_wheels_does_not_judge_them() -> None:
    trust = WheelTrust()
    trust.compare(np.array((1.0, 1.0, 1.0)), CLAIMED, 0.9 * CLAIMED)
    assert np.array_equal(trust.scaled(CLAIMED), CLAIMED)
