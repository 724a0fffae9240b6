"""The laser sits where the data set says, unless the configuration says otherwise."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.errors import DataSetError
from runtime.importers.archive import Archive
from runtime.importers.data_set import import_data_set
from runtime.importers.mount import mount_of
from runtime.record.reader import RunReader
from runtime.replay.replay import replay_run
from runtime.settings.configuration import load_configuration, load_configuration_text
from runtime.source_tree import CONFIG
from tests.support.runtime.data_sets import POSES, SCANS, write_set


def archive(**meta: Any) -> Archive:
    return Archive("a", Path("a.npz"), {}, meta)


@pytest.mark.parametrize(
    ("meta", "mount"),
    [
        ({}, {}),
        ({"vehicle": {"laser_x": 0.25}}, {"x_m": 0.25}),
        (
            {"geometry": {"laser_x": 0.78, "laser_y": -0.1, "laser_yaw": 3.0}},
            {"x_m": 0.78, "y_m": -0.1, "yaw_rad": 3.0},
        ),
        ({"vehicle": {"laser_offset_m": 0.145}}, {"x_m": 0.145}),
        ({"laser_x": 0.1}, {"x_m": 0.1}),
        ({"vehicle": {"laser_upside_down": True}}, {"upside_down": True}),
        ({"vehicle": {"laser_yaw": -6.2832}}, {"yaw_rad": pytest.approx(0.0, abs=1e-4)}),
        (
            {"vehicle": {"a": 3.78, "b": 0.5, "laser": "laser at (a,b) ahead/left of rear axle"}},
            {"x_m": 3.78, "y_m": 0.5},
        ),
    ],
)
def test_the_mount_of_a_description_is_found(meta: dict[str, Any], mount: dict[str, float]) -> None:
    assert mount_of(archive(**meta)) == mount


@pytest.mark.parametrize(
    "meta",
    [
        {"vehicle": "a small one"},
        {"vehicle": {"laser_x": "0.25"}},
        {"vehicle": {"laser_x": 250}},
        {"vehicle": {"laser_x": float("nan")}},
        {"geometry": {"laser_yaw": True}},
        {"geometry": {"laser_yaw": 90.0}},
        {"vehicle": {"laser_upside_down": "yes"}},
        {"vehicle": {"laser": "laser at (a,b)"}},
    ],
)
def test_a_mount_that_cannot_be_is_refused_in_one_sentence(meta: dict[str, Any]) -> None:
    with pytest.raises(DataSetError, match=r"a\.npz: meta\..*expected") as caught:
        mount_of(archive(**meta))
    assert "\n" not in str(caught.value)


def imported(tmp_path: Path, slam: str) -> dict[str, Any]:
    config = tmp_path / "c.toml"
    config.write_text(f"[vehicle]\nmotion_model = 'pose'\n{slam}")
    source = write_set(tmp_path / "set", SCANS | POSES, {"name": "yard", "vehicle": {"laser_x": 0.25, "laser_y": 0.1}})
    return import_data_set(source, tmp_path / "run", config)


def test_a_configuration_without_a_mount_takes_the_sets(tmp_path: Path) -> None:
    result = imported(tmp_path, "")
    assert result["mount"] == {"x_m": 0.25, "y_m": 0.1, "yaw_rad": 0.0, "upside_down": False}
    recorded = load_configuration_text(RunReader(tmp_path / "run").header.configuration_text)
    assert recorded.slam.mount.x_m == 0.25
    assert [note.partition(" = ")[0] for note in result["notes"]] == ["slam.mount.x_m", "slam.mount.y_m"]


def test_a_configuration_that_says_otherwise_wins_with_one_sentence(tmp_path: Path) -> None:
    result = imported(tmp_path, "[slam.mount]\nx_m = 0.3\n")
    assert (result["mount"]["x_m"], result["mount"]["y_m"]) == (0.3, 0.1)
    assert "slam.mount.x_m = 0.3 of the configuration is used; the data set's description says 0.25" in result["notes"]


def test_a_replay_with_another_file_keeps_the_mount_that_the_file_leaves_out(tmp_path: Path) -> None:
    imported(tmp_path, "")
    other = tmp_path / "other.toml"
    for slam, wanted in (("", (0.25, 0.1)), ("[slam.mount]\ny_m = 0.0\n", (0.25, 0.0))):
        other.write_text(f"[vehicle]\nmotion_model = 'pose'\n{slam}")
        out = replay_run(tmp_path / "run", other, None, False, {})["out"]
        mount = load_configuration(Path(out) / "config.toml").slam.mount
        assert (mount.x_m, mount.y_m) == wanted
    out = replay_run(tmp_path / "run", CONFIG / "carmen.toml", None, False, {"slam.mount.x_m": "0.0"})["out"]
    assert load_configuration(Path(out) / "config.toml").slam.mount.x_m == 0.0


def test_a_file_beside_the_arrays_describes_the_set_as_well(tmp_path: Path) -> None:
    source = write_set(tmp_path / "set", SCANS | POSES, {"name": "yard"})
    (source / "meta.json").write_text('{"vehicle": {"laser_x": 0.5}}')
    assert import_data_set(source, tmp_path / "run", CONFIG / "carmen.toml")["mount"]["x_m"] == 0.5


def test_counts_under_a_configuration_of_poses_are_refused(tmp_path: Path) -> None:
    counts = {"odom_t": POSES["odom_t"], "odom_ticks": np.zeros((len(POSES["odom_t"]), 2))}
    source = write_set(tmp_path / "set", SCANS | counts, {"name": "yard"})
    with pytest.raises(DataSetError, match=r"odometry is counts of two wheels, but vehicle\.motion_model = 'pose'"):
        import_data_set(source, tmp_path / "run", CONFIG / "carmen.toml")
    assert not (tmp_path / "run").exists()


def test_odometry_as_poses_may_be_rough_without_a_setting(tmp_path: Path) -> None:
    assert load_configuration_text("vehicle.motion_model = 'pose'").slam.odometry.jump_speed_mps == pytest.approx(40.05)
    config = tmp_path / "c.toml"
    for speed, warned in (("", 0), ("max_speed_mps = 2.0\n", 1)):
        config.write_text(f"[vehicle]\nmotion_model = 'pose'\n{speed}")
        fast = {"odom_pose": POSES["odom_pose"] * 10.0}
        source = write_set(tmp_path / f"set{warned}", SCANS | POSES | fast, {"name": "yard"})
        warnings = import_data_set(source, tmp_path / f"run{warned}", config)["warnings"]
        assert len(warnings) == warned
    assert (
        "will be rejected by the estimator: they move faster than 3 m/s, 1.5 times vehicle.max_speed_mps = 2"
        in warnings[0]
    )
