import json
import sys
from pathlib import Path

import numpy as np
import pytest

from runtime.errors import NotARunError, UsageError
from runtime.evaluate.evaluate import evaluate, evaluation_lines
from runtime.evaluate.smoothed import read_smoothed, smoothed_json_path
from runtime.record.folder import RunFolder
from runtime.report.build import examine
from runtime.smooth.smooth import at_ticks, smooth_lines, smooth_run
from tests.support.runtime.seeded_runs import seeded_facts
from tests.support.runtime.told_drive import told_drive, true_path

WRONG = {"landmark": 7, "start_s": 1.0, "end_s": 1.5, "sightings": 3, "off_m": 1.2, "square": 90.0}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("smooth") / "run"
    seeded_facts(folder, 5, duration_s=4.0)
    return folder


def test_a_run_is_smoothed_evaluated_and_reviewed(run: Path) -> None:
    before = evaluate(run)
    assert before["smoothed_apart_rms_m"] is None
    summary = smooth_run(run, lambda _: None)
    assert any("smoothed.tum" in line for line in smooth_lines(summary))
    landmarks = np.loadtxt(run / "smoothed_landmarks.csv", delimiter=",", skiprows=1)
    assert len(landmarks) == summary["landmarks"] > 3
    assert (landmarks[:, 3] > 0.0).all()
    figures = evaluate(run)
    assert figures["smoothed_rms_m"] < 0.1
    assert any("from the smoothed path" in line for line in evaluation_lines(figures))
    path = smoothed_json_path(RunFolder(run))
    result = json.loads(path.read_text())
    path.write_text(json.dumps(result | {"wrong_matches": [WRONG]}))
    finding = next(each for each in examine(run).findings if each.kind == "wrong_matches")
    assert finding.title == "A wrong match at 1.0 s"
    path.write_text(json.dumps(result | {"estimates": "another-replay", "wrong_matches": [WRONG]}))
    folder = RunFolder(run)
    assert read_smoothed(folder, folder) is None
    for damaged in ("{", json.dumps(result | {"scans": "many"}), json.dumps(result)[:-1] + ', "apart_rms_m": NaN}'):
        path.write_text(damaged)
        with pytest.raises(NotARunError, match="smooth the run again"):
            read_smoothed(folder, folder)


def test_without_gtsam_the_command_says_what_to_install(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gtsam", None)
    with pytest.raises(UsageError, match=r"pip install 'infant\[smooth\]'"):
        smooth_run(run, lambda _: None)


def test_between_scans_the_path_follows_the_wheels_to_the_next_scan() -> None:
    told, _ = told_drive()
    truth = true_path()
    rows = at_ticks(told, truth)
    assert np.abs(rows[:, 1:3] - truth[:, :2]).max() < 1e-9
    every_third = told_drive()[0]
    kept = np.arange(0, len(truth), 3)
    sparse = type(told)(
        **{name: getattr(every_third, name) for name in every_third.__slots__}
        | {"stamps_s": told.stamps_s[kept], "odometry": told.odometry[kept]}
    )
    between = at_ticks(sparse, truth[kept])
    assert np.hypot(*(between[:, 1:3] - truth[: len(between), :2]).T).max() < 0.3
