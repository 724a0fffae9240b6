"""What a review and an export cost, as ratios: how busy the machine is does not show in them."""

import os
from pathlib import Path

import numpy as np
import pytest

from runtime.errors import UsageError
from runtime.record.reader import RunReader
from runtime.studies.bench.of_a_run import measure_run
from tests.support.runtime.seeded_runs import clock_drift, seeded_facts

MOST_MB = 300  # 245 MB were measured for a drive of 26 minutes


@pytest.mark.timeout(600)
def test_review_and_export_take_less_time_than_the_drive_and_leave_the_run_as_it_was(tmp_path: Path) -> None:
    run = tmp_path / "runs" / "run"
    seeded_facts(run, 1, fault=clock_drift, duration_s=25.0)
    before = {path.name: path.read_bytes() for path in run.iterdir()}
    os.mkfifo(run / "pipe")
    (run / "link").symlink_to("/dev/zero")
    held = np.ones(50_000_000)  # 400 MB of this process are none of theirs
    figures = {figure.name: figure.value for figure in measure_run(run)}
    assert held.nbytes > MOST_MB * 1e6
    assert {name: (run / name).read_bytes() for name in before} == before
    assert list(run.parent.iterdir()) == [run]
    ticks = sum(1 for _ in RunReader(run).ticks())
    assert figures["recorded"] == pytest.approx(ticks / 10.0, abs=0.2)
    for command in ("review", "export_ros2"):
        assert 0.1 < figures[f"{command}_cpu"] < figures["recorded"]
        assert 30.0 < figures[f"{command}_memory"] < MOST_MB


def test_what_is_no_run_is_one_sentence(tmp_path: Path) -> None:
    for folder in (tmp_path / "nowhere", tmp_path):
        with pytest.raises(UsageError, match=f"^{folder}: expected the folder of a run"):
            list(measure_run(folder))
