"""Recordings of lasers that look all the way round are imported and replayed without a fault."""

from collections.abc import Callable
from pathlib import Path

import pytest

from runtime.importers.data_set import import_data_set
from runtime.record.reader import RunReader
from runtime.replay.replay import replay_run
from runtime.source_tree import CONFIG
from slam.estimate import Quality


@pytest.mark.parametrize("name", ["create3_hall", "furo_corridor"])
def test_a_laser_that_sees_all_round_is_replayed_and_never_lost(
    recorded_data: Callable[[str], Path], tmp_path: Path, name: str
) -> None:
    imported = import_data_set(recorded_data(name), tmp_path / "run", CONFIG / "carmen.toml")
    assert imported["warnings"] == []
    replayed = replay_run(tmp_path / "run", None, None, False, {})
    assert (replayed["scans"], replayed["defects"]) == (imported["scans"], 0)
    estimates = [tick.estimate for tick in RunReader(Path(replayed["out"])).ticks()]
    assert sum(each is None or each.quality is Quality.LOST for each in estimates) == 0


def test_people_around_a_laser_at_rest_do_not_move_it(recorded_data: Callable[[str], Path], tmp_path: Path) -> None:
    import_data_set(recorded_data("people_walk1"), tmp_path / "run", CONFIG / "carmen.toml", at_rest=True)
    replayed = replay_run(tmp_path / "run", None, None, False, {})
    *_, last = RunReader(Path(replayed["out"])).ticks()
    assert last.estimate is not None
    pose = last.estimate.map_from_body
    assert abs(pose.x_m) + abs(pose.y_m) < 0.01
    assert abs(pose.heading_rad) < 0.005
