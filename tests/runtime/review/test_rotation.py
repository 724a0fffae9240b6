"""A long run's picture comes in files that fit the segments: together one picture, each of them small, memory flat."""

import itertools
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from runtime.live.drawing_process import ReviewProcess
from runtime.messages.pipe import SEGMENT
from runtime.messages.tick import Record
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.manifest import Manifest
from runtime.record.room import make_room
from runtime.record.writing.recorder import Recorder
from runtime.review.drawing_state import DrawingState, caption
from runtime.review.rebuild import build_review
from runtime.review.viewer import (
    headless_viewer,
    last_time_s,
    reported_errors,
    review_paths,
    viewer_environment,
    viewer_path,
)
from runtime.review.writer import ReviewWriter
from runtime.settings.record import RecordSettings
from runtime.settings.review import ReviewSettings
from runtime.tick import CompletedTick
from tests.runtime.review.test_rebuild import Drawn
from tests.support.runtime.drawn_drive import MOUNT, drive
from tests.support.runtime.recorded_values import make_estimate, make_tick, make_timing
from tests.support.zenoh.wire import until

TICKS = 60
CLOSED_AFTER = (20, 40)
RENEWED_MB = 250.0
pytestmark = pytest.mark.usefixtures("patient_drawing")


def rotated(ticks: Iterator[list[Record]], closed_after: tuple[int, ...]) -> Iterator[Record]:
    """Records of a drive, with the word of the recorder after some ticks that a segment is closed."""
    for count, tick in enumerate(ticks, 1):
        yield from tick
        if count in closed_after:
            yield Record(SEGMENT, 0, b"%d" % (closed_after.index(count) + 1))


def drawn_in(folder: Path, records: Iterator[Record]) -> RunFolder:
    folder.mkdir()
    writer = ReviewWriter(folder / "review.rrd", ReviewSettings(), MOUNT)
    for record in records:
        writer.feed(record)
    writer.close()
    return RunFolder(folder)


def put(recorder: Recorder, seq: int) -> None:
    rng = np.random.default_rng(seq)
    recorder.put(
        CompletedTick(make_tick(seq, rng), make_estimate(1 + seq * 100_000_000, rng), make_timing(seq), b"", None)
    )


def test_the_parts_together_hold_what_one_file_holds(tmp_path: Path) -> None:
    parts = drawn_in(tmp_path / "parts", rotated(drive(TICKS), CLOSED_AFTER)).review_paths()
    assert [path.name for path in parts] == ["review-0001.rrd", "review-0002.rrd", "review.rrd"]
    whole = Drawn(drawn_in(tmp_path / "whole", rotated(drive(TICKS), ())).review_path)
    pieces = [Drawn(path) for path in parts]
    for entity in ("/map/rover", "/map/laser/kept", "/map/landmarks", "/plots/error/SLAM_m"):
        assert list(itertools.chain(*(piece.elapsed_s[entity] for piece in pieces))) == whole.elapsed_s[entity]
    points = [each for piece in pieces for each in piece.values[("/map/laser/kept", "positions")]]
    assert points == whole.values[("/map/laser/kept", "positions")]


def test_every_part_can_be_looked_at_alone(tmp_path: Path) -> None:
    for path in drawn_in(tmp_path / "parts", rotated(drive(TICKS), CLOSED_AFTER)).review_paths():
        part = Drawn(path)
        assert part.values[("/map/rover/shape", "strips")]
        assert len(part.elapsed_s["/map/rover"]) >= 19
        assert b"blueprint" in path.read_bytes()


def test_every_closed_part_is_whole_for_other_tools(tmp_path: Path) -> None:
    parts = drawn_in(tmp_path / "parts", rotated(drive(TICKS), CLOSED_AFTER)).review_paths()
    verify = [viewer_path(), "rrd", "verify", *map(str, parts)]
    verified = subprocess.run(verify, env=viewer_environment(), capture_output=True, text=True, check=False)
    assert verified.returncode == 0, verified.stderr
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(parts[0].read_bytes()[:-200])
    assert subprocess.run([viewer_path(), "rrd", "verify", str(cut)], capture_output=True, check=False).returncode != 0


def test_the_picture_says_where_the_run_began_and_ended_and_how_it_went(tmp_path: Path) -> None:
    parts = [Drawn(path) for path in drawn_in(tmp_path / "parts", rotated(drive(TICKS), CLOSED_AFTER)).review_paths()]
    assert [len(part.elapsed_s["/map/start"]) for part in parts] == [1, 0, 0]
    assert [len(part.elapsed_s["/map/end"]) for part in parts] == [0, 0, 1]
    state = DrawingState(driven_m=12.3, squared_error_m2=0.09, errors=1)
    said = caption(state, {"run": "yard", "created": "2026-01-01T00:00:00Z", "verdict": "healthy", "source": "live"})
    assert said == "yard | 2026-01-01T00:00:00Z | healthy | 12 m driven | error 0.300 m RMS | a square is 1 m"
    assert DrawingState.from_bytes(state.to_bytes()).driven_m == 12.3
    assert "error" not in caption(DrawingState(), {})


def test_who_looks_on_from_late_sees_where_the_rover_began_and_how_far_it_drove(tmp_path: Path) -> None:
    writer = ReviewWriter(tmp_path / "review.rrd", ReviewSettings(), MOUNT, {"run": "live"})
    writer.draw_before(np.array(((-30.0, 4.0), (-30.0, 0.0), (0.0, 0.0))))
    for record in itertools.chain(*drive(5)):
        writer.feed(record)
    writer.close()
    begun_m = np.array(Drawn(tmp_path / "review.rrd").values[("/map/start", "positions")])
    assert begun_m.ravel()[:2] == pytest.approx((-30.0, 4.0))
    assert b"34 m driven" in (tmp_path / "review.rrd").read_bytes()


def test_the_recorder_says_when_a_segment_is_closed_and_the_review_follows(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", tmp_path)
    review = ReviewProcess(folder.review_path, ReviewSettings(), MOUNT)
    recorder = Recorder(folder, RunHeader.of_live_run("", {}), RecordSettings(segment_s=0.5), [review])
    count = itertools.count()

    def has_parts() -> bool:
        if review.health().depth < 100:  # no faster than it is drawn: what does not fit its queue is left out
            put(recorder, next(count))
        return len(folder.review_paths()) > 3

    assert until(has_parts)
    recorder.close()
    review.close()
    assert review.health().trouble == ""
    closed = [f"run-{number:04d}.mcap" for number in folder.closed_segments()]
    drawn = [path.name.replace("review", "run").replace(".rrd", ".mcap") for path in folder.review_paths()[:-1]]
    assert drawn == closed[: len(drawn)]
    # on a busy machine the last segments may pass without a tick, and then nothing is drawn
    with_ticks = [number for number in folder.closed_segments() if folder.closed_path(number).stat().st_size > 10_000]
    assert len(drawn) >= max(with_ticks) - 1


def test_a_child_that_has_grown_is_followed_by_another_and_nothing_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("runtime.live.drawing_process.RENEW_MB", 1.0)
    (tmp_path / "renewed").mkdir()
    process = ReviewProcess(tmp_path / "renewed" / "review.rrd", ReviewSettings(), MOUNT)
    pids = {process.pid}
    for record in rotated(drive(TICKS), CLOSED_AFTER):
        process.feed(record)
        if record.topic == SEGMENT:
            assert until(lambda: process.pid not in pids)
            pids.add(process.pid)
    drawn = tmp_path / "renewed" / "review.rrd"
    assert until(lambda: process.health().depth == 0 and drawn.exists())
    process.close()
    assert (process.health().dropped, process.health().trouble, len(pids)) == (0, "", 3)
    whole = Drawn(drawn_in(tmp_path / "whole", rotated(drive(TICKS), ())).review_path)
    pieces = [Drawn(path) for path in RunFolder(tmp_path / "renewed").review_paths()]
    for entity in ("/map/rover", "/map/laser/kept", "/map/laser/trace", "/plots/error/SLAM_m"):
        assert list(itertools.chain(*(piece.elapsed_s[entity] for piece in pieces))) == whole.elapsed_s[entity]
    points = [each for piece in pieces for each in piece.values[("/map/laser/kept", "positions")]]
    assert points == whole.values[("/map/laser/kept", "positions")]


def test_made_again_it_is_one_file_and_the_parts_are_gone(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", tmp_path)
    recorder = Recorder(folder, RunHeader.of_live_run("", {}))
    for seq in range(20):
        put(recorder, seq)
    recorder.close()
    (folder.path / "review-0001.rrd").write_bytes(b"an old part")
    build_review(folder.path, folder.review_path)
    assert review_paths(folder) == [folder.review_path]


def test_a_segment_that_goes_for_room_takes_its_picture_along(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    for number in (1, 2):
        folder.closed_path(number).write_bytes(bytes(1000))
        (tmp_path / folder.closed_review_name(number)).write_bytes(bytes(1000))
    settings = RecordSettings(budget_gb=2.5e-6, keep_free_gb=0.0)
    assert make_room(folder, Manifest(folder.manifest_path), settings, is_full=False).trouble == ""
    assert sorted(path.name for path in tmp_path.glob("r*-*")) == ["review-0002.rrd", "run-0002.mcap"]


@pytest.mark.browser
def test_the_viewer_opens_all_parts_as_one_run(tmp_path: Path) -> None:
    folder = drawn_in(tmp_path / "parts", rotated(drive(120), (40, 80)))
    with headless_viewer(folder.review_paths(), (1200, 800)) as client:
        state = client.get_state()
        assert len(state.recordings) == 1
        assert last_time_s(state) == pytest.approx(11.9)
        assert reported_errors(state) == []


@pytest.mark.soak
@pytest.mark.timeout(1800)
def test_memory_stays_bounded_over_twenty_minutes_of_drawing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "runtime.live.drawing_process.RENEW_MB", RENEWED_MB
    )  # sooner than on a rover, so that it is seen
    process = ReviewProcess(tmp_path / "review.rrd", ReviewSettings(), MOUNT)
    resident_mb: list[float] = []
    for minute in range(20):
        for tick in drive(600, seed=minute, start_ns=5_000_000_000 + minute * 60_000_000_000):
            for record in tick:
                process.feed(record)
            assert until(lambda: process.health().depth < 3000, 300.0)
        process.feed(Record(SEGMENT, 0, b"%d" % (minute + 1)))
        part = tmp_path / RunFolder.closed_review_name(minute + 1)
        assert until(part.exists, 300.0)
        status = Path(f"/proc/{process.pid}/status").read_text()
        resident_mb.append(next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS")) / 1e3)
    process.close()
    assert process.health().dropped == 0
    assert max(resident_mb) < RENEWED_MB + 20.0, resident_mb
