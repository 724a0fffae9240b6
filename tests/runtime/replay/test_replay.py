"""A replay is the drive again to the last bit, or says where it is not."""

import dataclasses
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from drivers.measurements import WheelCounts
from runtime.errors import RunExistsError, UsageError
from runtime.importers.data_set import import_data_set
from runtime.messages.records import input_records, tick_records
from runtime.messages.tick import Gap, encode_gap
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RunWriter
from runtime.record.reader import RunReader
from runtime.replay.replay import ReplayResult, replay, replay_lines, replay_run, summarise_replay
from runtime.settings.configuration import load_configuration_text
from runtime.tick import CompletedTick, Tick
from slam.estimator import Estimator
from slam.pose import Pose2
from slam.settings.slam import SlamSettings
from tests.support.runtime.recorded_values import make_tick, make_timing
from tests.support.runtime.small_estimator import SmallEstimator

CONFIGURATION = load_configuration_text("seed = 3\n")
TICKS = 30


def small(settings: SlamSettings, seed: int) -> Estimator:
    return cast(Estimator, SmallEstimator(settings, seed))


def wrong_at(stamp_ns: int) -> Callable[[SlamSettings, int], Estimator]:
    def build(settings: SlamSettings, seed: int) -> Estimator:
        estimator = SmallEstimator(settings, seed)
        estimator.wrong_at_ns = stamp_ns
        return cast(Estimator, estimator)

    return build


def drive(folder: Path, ticks: int = TICKS, source: str = "live", gap_before: int | None = None) -> RunReader:
    """A recorded drive of the small estimator; the queue to the disk may have lost a tick."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(5)
    estimator = SmallEstimator(CONFIGURATION.slam, CONFIGURATION.seed)
    writer = RunWriter(folder / "run.mcap", RunHeader(CONFIGURATION.text, source).metadata)
    for seq in range(ticks):
        tick = make_tick(seq, rng, ("scan", "sightings", "nothing")[seq % 3])
        estimate = estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
        if seq == gap_before:
            writer.add([encode_gap(Gap(tick.stamp_ns, 1, 0, "the queue was full"))])
            continue
        truth = Pose2(float(seq), 0.0, 0.0)
        outcome = tick_records(CompletedTick(tick, estimate, make_timing(seq), estimator.state_hash(), truth))
        writer.add(input_records(tick) if source != "live" else outcome)
    writer.close()
    return RunReader(folder)


def test_a_replay_is_identical_to_the_drive(tmp_path: Path) -> None:
    result = replay(drive(tmp_path / "run"), CONFIGURATION, verify=True, estimator_factory=small)
    assert result.identical
    assert result.compared == TICKS
    assert result.difference == ""


def test_one_bit_of_a_pose_is_found_and_named(tmp_path: Path) -> None:
    reader = drive(tmp_path / "run")
    result = replay(reader, CONFIGURATION, verify=True, estimator_factory=wrong_at(1_700_000_000))
    assert result.identical is False
    assert result.difference.startswith("tick 17: map_from_body.x_m is ")


def test_a_hash_alone_that_differs_is_found(tmp_path: Path) -> None:
    other = load_configuration_text("seed = 4\n")
    result = replay(drive(tmp_path / "run"), other, verify=True, estimator_factory=small)
    assert result.difference.startswith("tick 0: state_hash is ")


def test_a_lost_tick_is_named_as_the_cause(tmp_path: Path) -> None:
    reader = drive(tmp_path / "run", gap_before=12)
    result = replay(reader, CONFIGURATION, verify=True, estimator_factory=small)
    assert result.identical is False
    assert "tick 13: the record lost 1 ticks" in result.difference


def test_without_estimates_nothing_is_called_identical(tmp_path: Path) -> None:
    reader = drive(tmp_path / "run", source="import toy")
    assert replay(reader, CONFIGURATION, verify=True, estimator_factory=small).identical is None


def test_a_replay_writes_a_run_that_replays_identically(tmp_path: Path) -> None:
    reader = drive(tmp_path / "run", source="import toy")
    out = RunFolder.create(tmp_path / "out", tmp_path)
    replay(reader, CONFIGURATION, out, estimator_factory=small)
    again = RunReader(out.path)
    assert again.header.source == "replay of run"
    assert again.header.is_of_others
    assert not dataclasses.replace(again.header, boot_id="a boot").is_of_others
    result = replay(again, CONFIGURATION, verify=True, estimator_factory=small)
    assert result.identical
    assert result.compared == TICKS
    first, second = (list(RunReader(folder).ticks()) for folder in (tmp_path / "run", out.path))
    assert [tick.inputs for tick in first] == [tick.inputs for tick in second]


def test_a_replay_keeps_truth_and_lateness_of_the_drive(tmp_path: Path) -> None:
    out = RunFolder.create(tmp_path / "out", tmp_path)
    replay(drive(tmp_path / "run"), CONFIGURATION, out, estimator_factory=small)
    recorded = list(RunReader(out.path).ticks())[9]
    assert recorded.truth == Pose2(9.0, 0.0, 0.0)
    assert recorded.timing is not None
    assert recorded.timing.lateness_ns == 9000


def test_a_truncated_run_replays_to_its_last_whole_tick_and_says_so(tmp_path: Path) -> None:
    drive(tmp_path / "run", 200)
    path = tmp_path / "run" / "run.mcap"
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 3 // 4])
    result = replay(RunReader(tmp_path / "run"), CONFIGURATION, verify=True, estimator_factory=small)
    assert 0 < result.ticks < 200
    assert result.identical
    assert f"{result.ticks} complete ticks can be read" in result.truncated


def test_memory_does_not_grow_with_the_run(tmp_path: Path) -> None:
    peaks = []
    for ticks in (200, 800):
        reader = drive(tmp_path / str(ticks), ticks)
        tracemalloc.start()
        replay(reader, CONFIGURATION, estimator_factory=small)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0]


def test_progress_ends_at_one_and_never_falls(tmp_path: Path) -> None:
    seen: list[float] = []
    replay(drive(tmp_path / "run", 120), CONFIGURATION, progress=seen.append, estimator_factory=small)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    assert len(seen) > 2


def test_the_summary_tells_it_all() -> None:
    result = ReplayResult(10, 5, 10, last_stamp_ns=2_000_000_000, elapsed_s=0.5)
    result.steps.add(1_000_000)
    summary = summarise_replay(result, "runs/x", None, "abc")
    assert summary["identical"] is True
    assert summary["times_real_time"] == 4.0
    assert summary["step_ms"] == {"p50": 1.0, "p99": 1.0, "max": 1.0}
    assert any("identical" in line for line in replay_lines(summary))
    result.difference = "tick 3: covariance[0, 0] is 1.0, recorded 2.0"
    assert any("DIFFERS: tick 3" in line for line in replay_lines(summarise_replay(result, "runs/x", None, "abc")))


def still_ticks(count: int) -> list[Tick]:
    rng = np.random.default_rng(8)
    ticks = [make_tick(seq, rng, "scan" if seq % 2 else "nothing", 200) for seq in range(count)]
    return [dataclasses.replace(tick, wheels=(WheelCounts(tick.stamp_ns, 0.0, 0.0),)) for tick in ticks]


@pytest.fixture
def imported(tmp_path: Path) -> Path:
    """A run that was imported: inputs only."""
    folder = tmp_path / "imported"
    folder.mkdir()
    configuration = load_configuration_text("seed = 3\n[slam]\nparticles = 5\n")
    writer = RunWriter(folder / "run.mcap", RunHeader(configuration.text, "import toy").metadata)
    for tick in still_ticks(12):
        writer.add(input_records(tick))
    writer.close()
    return folder


def test_the_estimator_itself_replays_to_the_last_bit(imported: Path, tmp_path: Path) -> None:
    first = replay_run(imported, None, tmp_path / "first", False, {})
    assert first["identical"] is None
    second = replay_run(tmp_path / "first", None, tmp_path / "second", True, {})
    assert second["identical"] is True
    assert second["compared"] == 12


def test_a_difference_under_other_code_says_so(imported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as other:
        other.setattr("runtime.record.header.sources_hash", lambda: "of last week")
        replay_run(imported, None, tmp_path / "first", False, {})
    monkeypatch.setattr(Estimator, "state_hash", lambda self: bytes(16))
    difference = replay_run(tmp_path / "first", None, None, True, {})["difference"]
    assert "state_hash" in difference
    assert "slam sources of last week, here " in difference


def test_a_setting_of_the_record_that_is_no_more_is_named_beside_the_difference(
    imported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replay_run(imported, None, tmp_path / "first", False, {})
    opened = RunReader.__init__

    def with_an_old_key(self: RunReader, path: Path) -> None:
        opened(self, path)
        text = self.header.configuration_text.replace("particles = ", "cell_m = 7.0\nparticles = ", 1)
        self.header = dataclasses.replace(self.header, configuration_text=text)

    monkeypatch.setattr(RunReader, "__init__", with_an_old_key)
    monkeypatch.setattr(Estimator, "state_hash", lambda self: bytes(16))
    difference = replay_run(tmp_path / "first", None, None, True, {})["difference"]
    assert "slam.cell_m = 7.0 is ignored, it is 15.0 (Tuning.cell_m in slam/settings/tuning.py)" in difference


def test_an_imported_run_keeps_its_replays_inside(imported: Path) -> None:
    summary = replay_run(imported, None, None, False, {"seed": "9"})
    newest = RunFolder.open(imported).newest_replay()
    assert newest is not None
    assert str(newest.path) == summary["out"]
    assert newest.configuration_path.read_text() == RunReader(newest.path).header.configuration_text
    assert "seed = 9" in newest.configuration_path.read_text()


def test_verify_with_another_configuration_is_refused(imported: Path, tmp_path: Path) -> None:
    replay_run(imported, None, tmp_path / "first", False, {})
    with pytest.raises(UsageError, match="leave out --config"):
        replay_run(tmp_path / "first", None, None, True, {"slam.particles": "7"})
    with pytest.raises(UsageError, match="has no estimates to verify"):
        replay_run(imported, None, None, True, {})


def test_a_replay_never_overwrites(imported: Path, tmp_path: Path) -> None:
    replay_run(imported, None, tmp_path / "first", False, {})
    with pytest.raises(RunExistsError):
        replay_run(imported, None, tmp_path / "first", False, {})


def test_a_real_drive_replays_to_the_last_bit(recorded_data: Callable[[str], Path], tmp_path: Path) -> None:
    import_data_set(recorded_data("sjursflat"), tmp_path / "run")
    few = {"slam.particles": "5"}
    replay_run(tmp_path / "run", None, tmp_path / "first", False, few)
    assert replay_run(tmp_path / "first", None, None, True, {})["identical"] is True
