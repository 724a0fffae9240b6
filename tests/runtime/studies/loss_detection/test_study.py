"""The study of lost rovers, small: a drive of each sort, judged again with other bounds."""

import json
from pathlib import Path

import pytest

from drivers.settings.simulated_world import WorldSettings
from runtime.studies.files import write_rows
from runtime.studies.jobs import Result
from runtime.studies.loss_detection.drives import KIDNAPPED, MishapKind, draw_mishap, simulated_ticks
from runtime.studies.loss_detection.picture import draw
from runtime.studies.loss_detection.study import (
    StudySize,
    alarms,
    curve,
    detected_after_s,
    drive_rows,
    found_back_s,
    noticed_after_s,
    point_row,
    study_jobs,
    summarise,
)
from runtime.studies.loss_detection.trial import COLUMNS, trial
from slam.pose import Pose2
from slam.settings.quality import QualitySettings

QUIET_S = 15.0


@pytest.fixture(scope="module")
def results() -> list[Result]:
    kinds = (MishapKind.MOVED, MishapKind.SILENT)
    drives = [trial(31, "park", kind.value, 0.0, 5, {}, "") for kind in kinds]
    return [*drives, trial(32, "crowd", "", QUIET_S, 5, {}, "")]


def test_judging_again_agrees_with_the_drive_itself(results: list[Result]) -> None:
    for result in results:
        assert result["kind"] == "" or detected_after_s(result, QualitySettings()) is not None
        lost = [state for state in result["states"] if state[1] == "lost"]
        assert bool(lost) == bool(result["kind"])
    assert alarms(results, QualitySettings()) == (0, 0)


def test_a_bound_out_of_reach_tells_of_nothing(results: list[Result]) -> None:
    assert detected_after_s(results[0], QualitySettings(lost_score=1e6, lost_blind_s=900.0)) is None


def test_the_summary_is_json_and_counts_every_drive(results: list[Result]) -> None:
    figures = json.loads(json.dumps(summarise(results)))
    assert (figures["kidnapped"]["runs"], figures["blinded"]["runs"], figures["false_alarms"]) == (1, 1, 0)


def test_back_is_where_the_pose_is_right_from_then_on() -> None:
    def drive(errors_m: list[float]) -> Result:
        rows = [[10.0 + 0.1 * number, *([0.0] * 7), error, 0.0, 0.0, 0.0] for number, error in enumerate(errors_m)]
        return {"at_s": 10.0, "trace": rows}

    assert found_back_s(drive([5.0, 5.0, 0.05, 3.0, 0.05, 0.02])) == pytest.approx(0.4)
    assert found_back_s(drive([5.0, 0.05, 0.3])) is None
    assert found_back_s(drive([0.05, 0.02])) == 0.0


def test_a_rover_that_is_right_again_at_once_need_not_say_that_it_is_lost(results: list[Result]) -> None:
    unaware = QualitySettings(lost_score=1e6, lost_blind_s=900.0)
    kidnapped, silent, _ = results
    assert noticed_after_s(kidnapped, unaware) == found_back_s(kidnapped)
    assert noticed_after_s(silent, unaware) is None


def test_the_study_has_as_many_drives_of_each_sort_as_it_was_asked_for() -> None:
    jobs = study_jobs(StudySize(100, 3.0, 10), "code")
    kinds = [job.arguments["kind"] for job in jobs]
    assert (sum(kind in KIDNAPPED for kind in kinds), kinds.count("")) == (100, 18)
    assert len({job.key for job in jobs}) == len(jobs)
    assert len(COLUMNS) == 12


@pytest.mark.parametrize("kind", KIDNAPPED)
def test_a_kidnapped_rover_is_elsewhere_while_its_wheels_report_nothing(kind: MishapKind) -> None:
    settings = WorldSettings(seed=5)
    mishap = draw_mishap(kind, settings)
    steps = list(simulated_ticks(settings, mishap.at_s + 0.5, mishap))
    ordinary = list(simulated_ticks(settings, mishap.at_s + 0.5))
    assert [step.wheels for step in steps] == [step.wheels for step in ordinary]
    last, expected = steps[-1].truth, ordinary[-1].truth
    jump = Pose2(*expected).inverse() @ Pose2(*last)
    moved = (jump.x_m**2 + jump.y_m**2) ** 0.5
    assert (moved > 0.9) == (kind is not MishapKind.TURNED)
    assert (abs(jump.heading_rad) > 0.3) == (kind is not MishapKind.MOVED)
    assert all((a.truth == b.truth).all() for a, b in zip(steps[:190], ordinary[:190], strict=True))


def test_the_curve_is_written_as_a_table_and_a_picture(results: list[Result], tmp_path: Path) -> None:
    points = curve(results)
    write_rows(tmp_path / "curve.csv", [point_row(point) for point in points])
    write_rows(tmp_path / "drives.csv", drive_rows(results))
    draw(points, tmp_path / "curve.png")
    assert len((tmp_path / "curve.csv").read_text().splitlines()) == len(points) + 1
    assert len((tmp_path / "drives.csv").read_text().splitlines()) == 4
    assert (tmp_path / "curve.png").stat().st_size > 5000
