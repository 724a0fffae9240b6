"""The figures of an evaluation are those that a person would compute by hand."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from drivers.measurements import FloatArray
from runtime.errors import ConfigurationError, UsageError
from runtime.evaluate.evaluate import (
    against_data_set,
    against_points,
    against_relations,
    against_simulation,
    evaluate,
    evaluation_lines,
)
from runtime.evaluate.rows import poses_at, read_tum, relative_poses, tum_text
from runtime.evaluate.truth import DataSetTruth
from runtime.importers.archive import load_archive
from runtime.importers.truth import truth_of
from runtime.importers.wheel_streams import wheel_samples
from runtime.messages.records import input_records, tick_records
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RunWriter
from runtime.record.trajectories import Trajectories
from runtime.settings.configuration import load_configuration_text
from runtime.tick import CompletedTick, Tick
from slam.estimate import Estimate, Quality
from slam.pose import Pose2, composed
from tests.support.runtime.recorded_values import make_timing

CONFIGURATION = load_configuration_text("[slam.mount]\nx_m = 2.0\ny_m = 0.5\n")
NO_MOUNT = (0.0, 0.0, 0.0)


def path(count: int = 60) -> FloatArray:
    """Rows of t, x, y, heading: a drive round a bend, ten poses a second."""
    t = np.arange(count) * 0.1
    heading = 0.4 * t
    return np.column_stack((t, np.cumsum(np.cos(heading)) * 0.1, np.cumsum(np.sin(heading)) * 0.1, heading))


def moved(trajectory: FloatArray, by: Pose2) -> FloatArray:
    """The same drive seen from another frame."""
    points = by.transform(trajectory[:, 1:3])
    return np.column_stack((trajectory[:, 0], points, trajectory[:, 3] + by.heading_rad))


def write_run(folder: Path, source: str = "live", simulated: bool = True, offset_m: float = 0.0) -> None:
    """A run whose estimates stand `offset_m` left of the truth."""
    folder.mkdir(parents=True)
    writer = RunWriter(folder / "run.mcap", RunHeader(CONFIGURATION.text, source).metadata)
    for seq, (t, x, y, heading) in enumerate(path().tolist()):
        tick = Tick(seq, round(t * 1e9), None, ())
        pose, true = Pose2(x, y + offset_m, heading), Pose2(x, y, heading)
        particles = Pose2(x + 0.4, y, heading)
        estimate = Estimate(tick.stamp_ns, pose, np.eye(3), particles, np.eye(3), true, Quality.TRACKING)
        records = tick_records(CompletedTick(tick, estimate, make_timing(seq), bytes(16), true if simulated else None))
        writer.add(input_records(tick) if source.startswith("import") else records)
    writer.close()


def test_a_run_against_its_simulator(tmp_path: Path) -> None:
    write_run(tmp_path / "run", offset_m=0.3)
    figures = evaluate(tmp_path / "run")
    assert figures["truth"] == "simulator"
    assert figures["rms_m"] == pytest.approx(0.3)
    assert figures["max_m"] == pytest.approx(0.3)
    assert figures["aligned_rms_m"] == pytest.approx(0.0, abs=1e-9)
    assert figures["odometry_rms_m"] == pytest.approx(0.0, abs=1e-9)
    assert figures["particles_rms_m"] == pytest.approx(0.4)
    assert figures["n"] == figures["poses"] == 60
    assert figures["relation_translation_m"] is None
    assert any("RMS 0.300 m" in line for line in evaluation_lines(figures))


def test_without_any_truth_every_figure_is_none_and_it_says_so(tmp_path: Path) -> None:
    write_run(tmp_path / "run", simulated=False)
    figures = evaluate(tmp_path / "run")
    for name in ("rms_m", "trimmed_rms_m", "max_m", "relation_translation_m", "relation_rotation_deg", "n"):
        assert figures[name] is None
    assert "none" in figures["truth"]


def test_a_truth_file_takes_the_place_of_what_the_run_holds(tmp_path: Path) -> None:
    write_run(tmp_path / "run")
    (tmp_path / "truth.tum").write_text(tum_text(moved(path(), Pose2(10.0, -3.0, 1.0))))
    figures = evaluate(tmp_path / "run", tmp_path / "truth.tum")
    assert figures["truth"] == "poses of truth.tum"
    assert figures["rms_m"] == pytest.approx(0.0, abs=1e-6)


def test_an_imported_run_is_evaluated_by_its_newest_replay(tmp_path: Path) -> None:
    write_run(tmp_path / "run", "import toy")
    with pytest.raises(UsageError, match="infant replay"):
        evaluate(tmp_path / "run")
    for name in ("20260101T000000Z-aaaaaa", "20260101T000001Z-bbbbbb"):
        write_run(tmp_path / "run" / "replays" / name, "replay of run", simulated=False)
        (tmp_path / "run" / "replays" / name / "summary.json").write_text("{}")
    write_run(tmp_path / "run" / "replays" / "20260101T000002Z-broken", "replay of run")  # no summary: not finished
    figures = evaluate(tmp_path / "run")
    assert figures["estimates"].endswith("bbbbbb")
    assert Path(figures["trajectory"]).parent == tmp_path / "run"


def test_fixes_are_compared_at_the_laser_and_outliers_only_reach_the_full_figures() -> None:
    body = path()
    laser = composed(body[:, 1:], np.array((2.0, 0.5, 0.0)))
    fixes = moved(np.column_stack((body[:, 0], laser)), Pose2(100.0, 50.0, -2.0))[:, :3]
    exact = against_points(Trajectories(body, body, body, None), fixes, (2.0, 0.5, 0.0))
    assert exact["rms_m"] == pytest.approx(0.0, abs=1e-9)
    elsewhere = against_points(Trajectories(body, body, body, None), fixes, NO_MOUNT)
    assert elsewhere["rms_m"] > 0.1
    fixes[30, 1] += 40.0
    wild = against_points(Trajectories(body, body, body, None), fixes, (2.0, 0.5, 0.0))
    assert wild["max_m"] > 30.0
    assert wild["trimmed_rms_m"] < 0.2 * wild["rms_m"]


def test_relations_do_not_care_about_the_frame() -> None:
    body = path()
    rows = np.array([[0, 50], [10, 40], [59, 3]])
    between = relative_poses(body[rows[:, 0], 1:], body[rows[:, 1], 1:])
    relations = np.column_stack((body[rows[:, 0], 0] + 0.02, body[rows[:, 1], 0] - 0.02, between))
    figures = against_relations(moved(body, Pose2(5.0, 5.0, 2.0)), relations)
    assert figures["relations"] == 3
    assert figures["relation_translation_m"] == pytest.approx(0.0, abs=1e-9)
    assert figures["relation_rotation_deg"] == pytest.approx(0.0, abs=1e-9)
    relations[0, 2:] += (0.3, 0.4, math.radians(9.0))
    figures = against_relations(body, relations)
    assert figures["relation_translation_m"] == pytest.approx(0.5 / 3, rel=1e-6)
    assert figures["relation_rotation_deg"] == pytest.approx(3.0, rel=1e-6)


def test_relations_farther_than_their_pairing_are_left_out() -> None:
    body = path()
    relations = np.array([[0.0, 100.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0]])
    assert against_relations(body, relations)["relations"] == 1
    assert against_relations(body, relations[:1]) == {"relations": 0}


def test_fixes_outside_of_the_estimates_are_not_extrapolated() -> None:
    body = path()
    fixes = np.array([[100.0, 0.0, 0.0], [101.0, 1.0, 0.0], [102.0, 2.0, 0.0]])
    assert "rms_m" not in against_points(Trajectories(body, body, body, None), fixes, NO_MOUNT)


def test_interpolation_takes_the_short_way_round() -> None:
    trajectory = np.array([[0.0, 0.0, 0.0, 3.0], [1.0, 1.0, 0.0, -3.0]])
    heading = poses_at(trajectory, np.array([0.5]))[0, 2]
    assert abs(abs(heading) - math.pi) < 0.01


def test_a_simulated_run_is_judged_in_the_frame_of_its_start() -> None:
    body = path()
    turned = moved(body, Pose2(0.0, 0.0, 0.1))
    figures = against_simulation(Trajectories(turned, body, body, body))
    assert figures["rms_m"] > 0.1
    assert figures["aligned_rms_m"] == pytest.approx(0.0, abs=1e-9)


def test_a_trajectory_file_comes_back(tmp_path: Path) -> None:
    (tmp_path / "a.tum").write_text("# a comment\n\n" + tum_text(path()))
    np.testing.assert_allclose(read_tum(tmp_path / "a.tum"), path(), atol=1e-8)


def test_evo_reads_the_trajectory_file(tmp_path: Path) -> None:
    tools = pytest.importorskip("evo.tools.file_interface", reason="evo is in the extra `dev`")
    (tmp_path / "a.tum").write_text(tum_text(path()))
    again = tools.read_tum_trajectory_file(str(tmp_path / "a.tum"))
    np.testing.assert_allclose(again.positions_xyz[:, :2], path()[:, 1:3], atol=1e-8)


@pytest.mark.parametrize("content", ["", "# nothing\n", "0 0 0\n", "0 0 0 0 0 0 0 one\n"])
def test_a_file_that_is_no_trajectory_is_refused_with_its_line(tmp_path: Path, content: str) -> None:
    (tmp_path / "a.tum").write_text(content)
    with pytest.raises(ConfigurationError, match=r"a\.tum"):
        read_tum(tmp_path / "a.tum")


def test_raw_odometry_of_intel_has_the_published_relation_error(recorded_data: Callable[[str], Path]) -> None:
    archive = load_archive(recorded_data("intel_lab"))
    truth = truth_of(archive)
    assert isinstance(truth, DataSetTruth)
    assert truth.relations is not None
    log = np.column_stack((archive["odom_t"] - archive.start_s, archive["odom_pose"]))
    figures = against_relations(log, truth.relations)
    assert figures["relations"] == 2418  # data README: 2418 of 2984 rows pair up, 7.24 m, 38.8 deg
    assert figures["relation_translation_m"] == pytest.approx(7.24, abs=0.01)
    assert figures["relation_rotation_deg"] == pytest.approx(38.8, abs=0.1)
    used = [(s.stamp_ns * 1e-9, s.x_m, s.y_m, s.heading_rad) for s in wheel_samples(archive)]  # type: ignore[union-attr]
    believed = against_relations(np.array(used), truth.relations)
    assert believed["relations"] >= 2418
    assert believed["relation_translation_m"] < 7.6


def test_a_set_with_reference_poses_and_relations_gives_both(recorded_data: Callable[[str], Path]) -> None:
    archive = load_archive(recorded_data("intel_lab"))
    truth = truth_of(archive)
    assert truth is not None
    assert truth.poses is not None
    itself = Trajectories(truth.poses, truth.poses, truth.poses, None)
    figures = against_data_set(itself, truth, NO_MOUNT)
    assert figures["rms_m"] == pytest.approx(0.0, abs=1e-9)
    assert figures["relation_translation_m"] < 0.2


def test_relations_and_poses_of_a_data_set_are_those_of_its_laser() -> None:
    body = np.array([(float(t), 0.0, 0.0, 0.5 * t) for t in range(7)])  # turns on the spot
    laser = np.array([(t, 0.3 * math.cos(heading), 0.3 * math.sin(heading), heading) for t, _, _, heading in body])
    between = relative_poses(laser[:-1, 1:], laser[1:, 1:])
    truth = DataSetTruth(poses=laser, relations=np.column_stack((laser[:-1, 0], laser[1:, 0], between)))
    ahead = against_data_set(Trajectories(body, body, body, None), truth, (0.3, 0.0, 0.0))
    assert ahead["relation_translation_m"] == pytest.approx(0.0, abs=1e-9)
    assert ahead["rms_m"] == pytest.approx(0.0, abs=1e-9)
    middle = against_data_set(Trajectories(body, body, body, None), truth, NO_MOUNT)
    assert middle["relation_translation_m"] > 0.1
    assert middle["rms_m"] > 0.1
