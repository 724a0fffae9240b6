"""The corrections of another SLAM are no motion of the wheels."""

from pathlib import Path

import numpy as np

from runtime.importers.carmen import load_carmen
from tests.support.runtime.carmen_logs import gmapping_log, imported, written


def test_corrections_of_gmapping_are_taken_out_of_the_odometry(tmp_path: Path) -> None:
    lines, wheels = gmapping_log(20)
    archive = load_carmen(written(tmp_path / "a.log", lines))
    expected = [(pose.x_m, pose.y_m, pose.heading_rad) for pose in wheels]
    np.testing.assert_allclose(archive["odom_pose"], expected, atol=1e-9)
    np.testing.assert_allclose(archive["scan_odom_pose"], expected, atol=1e-9)
    np.testing.assert_allclose(archive["gt_xy"][:, 1], 0.02 * np.arange(1, 21), atol=1e-9)
    assert archive.left_out.warnings == []
    assert archive.left_out.total("odometry samples") == 0  # the lines that repeat a scan's pose are no loss


def test_a_log_of_gmapping_without_the_wheels_lines_says_so(tmp_path: Path) -> None:
    lines, _ = gmapping_log(20)
    result = imported(tmp_path, [line for k, line in enumerate(lines) if k % 4 or k == 0])
    assert result["scans"] == 20
    assert any("corrected poses are used in its place" in warning for warning in result["warnings"])
