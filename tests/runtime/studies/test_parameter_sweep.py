import csv
import os
from pathlib import Path
from unittest import mock

import pytest

from runtime.errors import UsageError
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RunWriter
from runtime.studies.parameter_sweep import settings_grid, sweep


def test_every_combination_of_values_comes_once() -> None:
    grid = settings_grid(["slam.particles=10,30", "slam.proposal=ekf"])
    assert grid == [{"slam.particles": "10", "slam.proposal": "ekf"}, {"slam.particles": "30", "slam.proposal": "ekf"}]
    assert settings_grid([]) == [{}]


@pytest.mark.parametrize("words", [["slam.particles"], ["=3"], ["a=1,,2"], ["a=1", "a=2"]])
def test_a_word_of_another_form_is_refused(words: list[str]) -> None:
    with pytest.raises(UsageError, match="--set"):
        settings_grid(words)


def test_runs_and_tables_may_lie_where_a_path_is_not_utf_8(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    folder = tmp_path / os.fsdecode(b"b\xe4d")
    (folder / "out").mkdir(parents=True)
    RunWriter(folder / "run.mcap", RunHeader("seed = 1\n", "live").metadata).close()
    with mock.patch("runtime.studies.parameter_sweep.run_jobs", lambda jobs, *_: [{"ate_m": 1.0} for _ in jobs]):
        sweep([folder], [], 1, folder / "out", None, lambda done, of: None)
    (row,) = csv.DictReader((folder / "out" / "sweep.csv").open())
    assert row["run"].endswith("b\\udce4d")
    assert (folder / "out" / "sweep.parquet").stat().st_size
