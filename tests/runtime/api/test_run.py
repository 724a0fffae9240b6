"""Runs and arrays from Python, and the page that tells of it."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import runtime
from drivers.measurements import WheelCounts
from runtime.api.arrays import ticks_from_arrays
from runtime.api.run import open_run
from runtime.api.trajectory import Trajectory
from runtime.errors import NotARunError, UsageError
from runtime.messages.records import tick_records
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RunWriter
from runtime.settings.configuration import load_configuration_text
from runtime.source_tree import ROOT
from runtime.tick import CompletedTick, Tick, Timing
from slam.estimator import Estimator

CONFIGURATION = load_configuration_text("seed = 3\n[slam]\nparticles = 5\n")
TICKS = 8
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")


def room_ticks() -> Iterator[Tick]:
    stamps = 1_000_000_000 + 100_000_000 * np.arange(TICKS)
    bearings = np.deg2rad(np.arange(-90.0, 90.5, 0.5))
    return ticks_from_arrays(stamps, np.full((TICKS, bearings.size), 4.0), bearings, stamps, np.zeros((TICKS, 2)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some ticks in a round room, recorded with what the estimator said."""
    path = tmp_path_factory.mktemp("api") / "runs" / "yard"
    run = RunFolder.create(path, path)
    writer = RunWriter(run.mcap_path, RunHeader.of_live_run(CONFIGURATION.text, {}).metadata)
    estimator = Estimator(CONFIGURATION.slam, CONFIGURATION.seed)
    for tick in room_ticks():
        estimate = estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
        writer.add(tick_records(CompletedTick(tick, estimate, Timing(0, 0, {}), estimator.state_hash(), None)))
    writer.close()
    return path


def test_a_replay_without_settings_gives_the_recorded_bits_and_own_settings_are_taken(folder: Path) -> None:
    run = open_run(folder)
    recorded, again = run.recorded(), run.replay()
    np.testing.assert_array_equal(again.stamps_ns, recorded.stamps_ns)
    np.testing.assert_array_equal(again.poses, recorded.poses)
    np.testing.assert_array_equal(again.covariances, recorded.covariances)
    assert [tick.seq for tick in run.ticks()] == list(range(TICKS))
    other = CONFIGURATION.slam.model_copy(update={"particles": 7})
    assert [each.particles is not None and each.particles.shape for each in run.estimates(other)] == [(7, 3)] * TICKS


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotARunError):
        open_run(tmp_path)


def test_a_trajectory_of_nothing_has_no_rows(tmp_path: Path) -> None:
    nothing = Trajectory.of([])
    assert nothing.poses.shape == (0, 3)
    nothing.write_tum(tmp_path / "nothing.tum")
    assert (tmp_path / "nothing.tum").read_text() == ""


def test_arrays_are_copied_and_what_is_out_of_range_is_no_return() -> None:
    ranges = np.array([[1.0, np.inf, -1.0, 99.0]])
    bearings = np.array([-0.1, 0.0, 0.1, 0.2])
    (tick,) = ticks_from_arrays([10], ranges, bearings, [5, 9], [[1, 2], [3, 4]])
    assert tick.scan is not None
    np.testing.assert_array_equal(np.isnan(tick.scan.ranges_m), [False, True, True, True])
    assert tick.wheels == (WheelCounts(5, 1.0, 2.0), WheelCounts(9, 3.0, 4.0))
    ranges[0, 0] = bearings[0] = 7.0
    assert tick.scan.ranges_m[0] == 1.0


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"scan_stamps_ns": [0.1]}, "scan_stamps_ns has the type float64"),
        ({"scan_stamps_ns": [[1]]}, "expected integers in ns"),
        ({"ranges_m": [[1.0, 2.0]]}, r"ranges_m has the shape \(1, 2\)"),
        ({"wheel_stamps_ns": [2, 2], "wheel_counts": [[0, 0], [0, 0]]}, "wheel_stamps_ns must increase"),
        ({"wheel_counts": [[0]]}, r"wheel_counts has the shape \(1, 1\)"),
        ({"wheel_counts": [[0, np.nan]]}, "must be finite"),
        ({"scan_stamps_ns": [1 << 62]}, "reaches beyond"),
    ],
)
def test_arrays_that_do_not_fit_are_refused_by_name(changed: dict[str, object], named: str) -> None:
    arrays: dict[str, object] = {"scan_stamps_ns": [1], "ranges_m": [[1.0]], "bearings_rad": [0.0]}
    arrays |= {"wheel_stamps_ns": [1], "wheel_counts": [[0, 0]]} | changed
    with pytest.raises(UsageError, match=named):
        ticks_from_arrays(**arrays)  # type: ignore[arg-type]


def test_every_block_of_the_page_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder.parents[1])
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    assert len(blocks) >= 4
    for block in blocks:
        exec(compile(block, "docs/python.md", "exec"), {})  # noqa: S102 our own page
    assert len((folder.parents[1] / "sixty.tum").read_text().splitlines()) == TICKS


def test_every_public_name_is_there_and_the_page_tells_of_those_it_imports() -> None:
    for name in runtime.__all__:
        assert getattr(runtime, name) is not None
    assert "from runtime import open_run" in PAGE


def test_the_example_project_passes_with_the_plugin() -> None:
    """As another project's CI would run it."""
    example = ROOT / "docs" / "examples" / "rover_ci"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "runtime.api.pytest_plugin", "-p", "no:cacheprovider", "."]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=example, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 passed" in done.stdout


def test_the_plugin_costs_other_sessions_nothing() -> None:
    check = (
        "import sys, runtime.api.pytest_plugin;"
        "print([name for name in ('numpy', 'numba', 'pydantic', 'can') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.stdout.strip() == "[]", done.stderr
