"""The figures of an evaluation are those that a person would compute by hand."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from drivers.measurements import FloatArray
from runtime.errors import ConfigurationError, UsageError
from runtime.evaluate.against_truth import relation_error
from runtime.evaluate.evaluate import against_data_set, against_simulation, evaluate, evaluation_lines
from runtime.evaluate.rows import poses_at, read_tum, tum_text
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
from slam.pose import Pose2
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


def write_run(
    folder: Path, source: str = "live", simulated: bool = True, offset_m: float = 0.0, wall_ns: int | None = None
) -> None:
    """A run whose estimates stand `offset_m` left of the truth."""
    folder.mkdir(parents=True)
    writer = RunWriter(
        folder / "run.mcap", RunHeader(CONFIGURATION.text, source, wall_minus_monotonic_ns=wall_ns).metadata
    )
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
    assert figures["n"] == figures["n_known"] == figures["poses"] == 60
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


def test_a_replay_kept_elsewhere_is_evaluated_like_a_run(tmp_path: Path) -> None:
    write_run(tmp_path / "out", "replay of run", offset_m=0.2)
    figures = evaluate(tmp_path / "out")
    assert figures["rms_m"] == pytest.approx(0.2)
    assert Path(figures["truth_trajectory"]) == tmp_path / "out" / "truth.tum"


def test_estimate_odometry_and_truth_are_written_in_one_time_base(tmp_path: Path) -> None:
    write_run(tmp_path / "run", offset_m=0.3)
    figures = evaluate(tmp_path / "run")
    estimated, odometry, truth = (
        read_tum(Path(figures[name])) for name in ("trajectory", "odometry_trajectory", "truth_trajectory")
    )
    np.testing.assert_allclose(estimated[:, 0], truth[:, 0])
    np.testing.assert_allclose(odometry, truth, atol=1e-8)  # the wheels of this drive make no error
    np.testing.assert_allclose(estimated[:, 2] - truth[:, 2], 0.3, atol=1e-8)
    assert Path(figures["odometry_trajectory"]).name == "odometry.tum"


def test_truth_in_seconds_since_1970_is_brought_to_the_time_of_the_run(tmp_path: Path) -> None:
    write_run(tmp_path / "run", wall_ns=1_700_000_000 * 10**9, simulated=False)
    late = path() + np.array([1_700_000_000.0, 0.0, 0.0, 0.0])
    (tmp_path / "truth.tum").write_text(tum_text(late))
    figures = evaluate(tmp_path / "run", tmp_path / "truth.tum")
    assert (figures["n"], figures["n_known"]) == (60, 60)
    np.testing.assert_allclose(read_tum(tmp_path / "run" / "truth.tum")[:, 0], path()[:, 0], atol=1e-6)


def test_truth_of_another_time_is_refused_with_both_times(tmp_path: Path) -> None:
    write_run(tmp_path / "run")
    (tmp_path / "truth.tum").write_text(tum_text(path() + np.array([1000.0, 0.0, 0.0, 0.0])))
    with pytest.raises(UsageError, match=r"1000\.000 to 1005\.900 s.*0\.000 to 5\.900 s"):
        evaluate(tmp_path / "run", tmp_path / "truth.tum")


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


@pytest.mark.parametrize(
    "content",
    [
        *("", "# nothing\n", "0 0 0\n", "0 0 0 0 0 0 0 one\n", "nan 0 0 0 0 0 0 1\n", "0 1e200 0 0 0 0 0 1\n"),
        "1 0 0 0 0 0 0 1\n0.5 0 0 0 0 0 0 1\n",
    ],
)
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
    error, used = relation_error(log, truth.relations)
    assert error is not None
    assert used == 2984  # all of them
    assert error.translation_m == pytest.approx(7.24, abs=0.3)  # data README: 7.24 m, 38.8 deg over 2418 of them
    assert error.rotation_deg == pytest.approx(38.8, abs=1.0)
    used_rows = np.array([(s.stamp_ns * 1e-9, s.x_m, s.y_m, s.heading_rad) for s in wheel_samples(archive)])  # type: ignore[union-attr]
    believed, _ = relation_error(used_rows, truth.relations)
    assert believed is not None
    assert believed.translation_m < 7.6


def test_a_set_with_reference_poses_and_relations_gives_both(recorded_data: Callable[[str], Path]) -> None:
    archive = load_archive(recorded_data("intel_lab"))
    truth = truth_of(archive)
    assert truth is not None
    assert truth.poses is not None
    itself = Trajectories(truth.poses, truth.poses, truth.poses, None)
    figures = against_data_set(itself, truth, NO_MOUNT)
    assert figures["rms_m"] == pytest.approx(0.0, abs=1e-9)
    assert figures["relation_translation_m"] < 0.2
