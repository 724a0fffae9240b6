"""The picture holds what the records hold, in the map's frame, and costs what it may cost."""

import math
import resource
import time
from collections import defaultdict
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from drivers.measurements import Scan
from runtime.errors import StorageError
from runtime.messages.tick import Gap, Record, encode_gap, encode_tick
from runtime.review.columns import ellipse_axes, mixed
from runtime.review.layout import Extent
from runtime.review.rebuild import drawn_meanwhile
from runtime.review.ticks import ELAPSED, TICK, BeamPoints, Motion, TickAssembler
from runtime.review.writer import ReviewWriter
from runtime.settings.review import ReviewSettings
from slam.estimate import Estimate
from slam.pose import Pose2
from tests.support.runtime.drawn_drive import MOUNT, YARD_M, drive
from tests.support.runtime.recorded_values import make_estimate

TICKS = 60


class Drawn:
    """An .rrd read back: values by entity and component, in the order of time."""

    def __init__(self, path: Path) -> None:
        from rerun.chunk import RrdReader

        self.values: dict[tuple[str, str], list[Any]] = defaultdict(list)
        self.elapsed_s: dict[str, list[float]] = defaultdict(list)
        for chunk in RrdReader(path).stream():
            batch = pa.record_batch(chunk.to_record_batch())
            entity = str(chunk.entity_path)
            for name in batch.schema.names:
                column = batch.column(name)
                if name == "elapsed":
                    self.elapsed_s[entity] += [value.value * 1e-9 for value in column.cast(pa.duration("ns"))]
                elif ":" in name:
                    self.values[(entity, name.rsplit(":", 1)[1])] += column.to_pylist()

    def points(self, entity: str, row: int) -> NDArray[np.float64]:
        return np.array(self.values[(entity, "positions")][row]).reshape(-1, 3)


def draw(path: Path, records: list[Record], **changes: Any) -> Drawn:
    writer = ReviewWriter(path, ReviewSettings(**changes), MOUNT)
    for record in records:
        writer.feed(record)
    writer.close()
    return Drawn(path)


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return [record for tick in drive(TICKS) for record in tick]


@pytest.fixture(scope="module")
def drawn(records: list[Record], tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    return draw(tmp_path_factory.mktemp("run") / "review.rrd", records)


def test_every_tick_has_its_pose_particles_and_points(drawn: Drawn) -> None:
    assert len(drawn.values[("/map/rover", "translation")]) == TICKS
    assert len(drawn.values[("/map/particles", "positions")]) == TICKS
    assert drawn.points("/map/particles", 5).shape == (100, 3)
    assert drawn.elapsed_s["/map/rover"] == pytest.approx(0.1 * np.arange(TICKS))


def test_walls_are_drawn_where_they_stand(drawn: Drawn) -> None:
    kept_m = drawn.points("/map/laser/kept", TICKS - 1)
    on_a_wall = np.abs(np.abs(kept_m[:, :2]).max(axis=1) - YARD_M) < 0.3
    assert on_a_wall.mean() > 0.6


def test_points_that_moved_are_drawn_as_rejected_where_the_person_walks(drawn: Drawn) -> None:
    for seq in range(TICKS):
        person_m = np.array(((-15.0 + 0.12 * seq) % 40 - 20, 3.0))
        rejected_m = drawn.points("/map/laser/rejected", seq)[:, :2]
        assert (np.linalg.norm(rejected_m - person_m, axis=1) < 0.5).all()
    kept, rejected, other = (
        sum(len(drawn.points(f"/map/laser/{name}", row)) for row in range(TICKS))
        for name in ("kept", "rejected", "not_compared")
    )
    assert kept > 5 * other > 0
    assert rejected > 0


def test_a_refused_feature_says_by_which_technique(drawn: Drawn) -> None:
    labels = {label for row in drawn.values[("/map/association/new_and_refused", "labels")] for label in row or ()}
    assert labels == {"new", "difference", "density", "exclusivity", "range"}


def test_a_matched_feature_has_a_spoke_to_its_landmark(drawn: Drawn) -> None:
    spokes = drawn.values[("/map/association/matched", "strips")][-1]
    landmarks_m = np.array(drawn.values[("/map/landmarks", "positions")][-1])
    ends_m = np.array([[list(point) for point in spoke] for spoke in spokes])[:, -1]
    nearest_m = np.linalg.norm(ends_m[:, None, :2] - landmarks_m[None, :, :2], axis=2).min(axis=1)
    assert np.median(nearest_m) < 0.01


def test_a_path_comes_in_pieces_that_join(drawn: Drawn) -> None:
    for name in ("SLAM", "odometry", "truth"):
        pieces = [np.array(row[0]) for row in drawn.values[(f"/map/path/{name}", "strips")]]
        assert len(pieces) == TICKS / 10
        for before, after in pairwise(pieces):
            np.testing.assert_array_equal(before[-1], after[0])
        assert sum(len(piece) - 1 for piece in pieces) == TICKS - 1


def test_of_paths_that_lie_over_one_another_the_published_one_is_seen(drawn: Drawn) -> None:
    heights_m = [drawn.values[(f"/map/path/{name}", "strips")][0][0][0][2] for name in ("odometry", "truth", "SLAM")]
    assert heights_m == sorted(set(heights_m))


def test_paths_are_drawn_up_to_the_cursor_on_either_timeline(records: list[Record], tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    draw(tmp_path / "review.rrd", records[:40])
    reader, shown = RrdReader(tmp_path / "review.rrd"), []
    for chunk in reader.stream(store=reader.blueprints()[-1]):
        batch = pa.record_batch(chunk.to_record_batch())
        if "VisibleTimeRanges:ranges" in batch.schema.names and "map/path/SLAM" in str(chunk.entity_path):
            shown += batch.column("VisibleTimeRanges:ranges").to_pylist()
    assert shown
    assert all({each["timeline"] for each in ranges} == {ELAPSED, TICK} for ranges in shown)


def test_curves_and_events_are_there(drawn: Drawn) -> None:
    for curve in ("timing/lateness_ms", "filter/effective_particles", "error/SLAM_m", "sensors/laser_age_ms"):
        assert len(drawn.values[(f"/plots/{curve}", "scalars")]) == TICKS
    assert drawn.values[("/plots/sensors/laser_age_ms", "scalars")][3] == [pytest.approx(40.0)]
    texts = [row[0] for row in drawn.values[("/events", "text")]]
    assert texts == ["pose quality: tracking", "laser checksum: one line had a wrong sum"]


def test_the_layout_is_inside_the_file(records: list[Record], tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    path = tmp_path / "review.rrd"
    draw(path, records[:40])
    assert len(RrdReader(path).blueprints()) >= 1
    assert len(RrdReader(path).recordings()) == 1


def test_the_same_records_draw_the_same(records: list[Record], tmp_path: Path) -> None:
    first, second = draw(tmp_path / "a.rrd", records), draw(tmp_path / "b.rrd", records)
    assert first.values[("/map/laser/kept", "positions")] == second.values[("/map/laser/kept", "positions")]


def test_a_minute_takes_less_than_ten_megabytes(tmp_path: Path) -> None:
    path = tmp_path / "review.rrd"
    few, many = 100, 200
    sizes = []
    for ticks in (few, many):
        draw(path, [record for tick in drive(ticks) for record in tick])
        sizes.append(path.stat().st_size)
    assert (sizes[1] - sizes[0]) / (many - few) * 600 < 10e6


def test_a_lost_scan_costs_one_tick_of_the_picture(records: list[Record], tmp_path: Path) -> None:
    scans = [k for k, record in enumerate(records) if record.topic == "/scan"]
    without = [record for k, record in enumerate(records) if k != scans[7]]
    assert len(draw(tmp_path / "review.rrd", without).values[("/map/rover", "translation")]) == TICKS - 1


def test_what_the_record_lost_is_said(records: list[Record], tmp_path: Path) -> None:
    gap = encode_gap(Gap(5_000_000_000, 3, 40, "the disk was full"))
    texts = [row[0] for row in draw(tmp_path / "review.rrd", [gap, *records[:30]]).values[("/events", "text")]]
    assert texts[0] == "record gap: 3 tick(s) and 40 raw message(s) lost: the disk was full"


def test_scans_on_every_other_tick_leave_a_trace_all_the_same(
    records: list[Record], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sparse, blind = [], False
    for record in records:
        if record.topic == "/scan":
            blind = not blind
        if not blind:
            sparse.append(record)
        elif record.topic == "/tick":
            seen = TickAssembler()
            seen.feed(Record("/scan", 0, records[0].data))
            seen.feed(record)
            assembled = seen.last()
            assert assembled is not None
            sparse.append(encode_tick(replace(assembled.tick, scan=None)))
        elif record.topic != "/scan":
            sparse.append(record)
    monkeypatch.setattr("runtime.review.writer.TRACE_EVERY", 5)
    drawn = draw(tmp_path / "review.rrd", sparse)
    traces = drawn.elapsed_s["/map/laser/trace"]
    assert np.diff(traces) == pytest.approx(np.full(len(traces) - 1, 0.6)), "the first scan after 5 ticks"


def test_without_truth_no_true_rover_is_drawn(records: list[Record], tmp_path: Path) -> None:
    without = draw(tmp_path / "review.rrd", [record for record in records if record.topic != "/truth"])
    assert not [entity for entity, _ in without.values if entity.startswith("/map/truth")]


def test_a_run_without_estimates_draws_what_it_has(records: list[Record], tmp_path: Path) -> None:
    inputs = [record for record in records if record.topic in ("/scan", "/tick")]
    drawn = draw(tmp_path / "review.rrd", inputs)
    assert len(drawn.values[("/plots/sensors/laser_age_ms", "scalars")]) == TICKS


def test_a_folder_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="cannot be written"):
        ReviewWriter(tmp_path / "no" / "review.rrd", ReviewSettings())


def test_a_disk_that_fills_up_is_one_sentence_at_the_end(records: list[Record], tmp_path: Path) -> None:
    writer = ReviewWriter(tmp_path / "review.rrd", ReviewSettings())
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))  # writes beyond fail as on a full disk
    try:
        for record in records:
            writer.feed(record)
        with pytest.raises(StorageError, match=r"is incomplete .* free space"):
            writer.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("room", [0, 3000, 20_000, 60_000])
def test_a_disk_that_is_full_from_the_start_is_one_sentence(tmp_path: Path, room: int) -> None:
    """rerun waited for ever for its layout to be written, and who waited for the picture with it."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        with pytest.raises(StorageError, match="cannot be written"):
            ReviewWriter(tmp_path / "review.rrd", ReviewSettings())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.timeout(30)
def test_a_process_that_does_not_end_when_it_is_told_to_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deaf, ready = tmp_path / "deaf", tmp_path / "ready"
    deaf.write_text(f"#!/bin/sh\ntrap '' TERM\ntouch {ready}\nexec sleep 60\n")
    deaf.chmod(0o700)
    monkeypatch.setattr("runtime.review.rebuild.ENDS_S", 0.1)
    monkeypatch.setattr("sys.executable", str(deaf))
    with drawn_meanwhile(tmp_path, tmp_path / "review.rrd"):
        while not ready.exists():  # who looked at the run has ended
            time.sleep(0.01)


def test_a_beam_is_drawn_where_the_laser_was_when_it_was_taken() -> None:
    """A rover turning at 1 rad/s sees a point straight ahead 50 ms before its pose is told."""
    rng = np.random.default_rng(1)
    before, now = make_estimate(0, rng), make_estimate(100_000_000, rng)
    turning = Motion(100_000_000, Pose2(3.0, 2.0, 0.5), 100_000_000, Pose2(0.0, 0.0, -0.1))
    point_m = turning.to_map(np.array([50_000_000]), np.array([[10.0, 0.0]]), Pose2())
    expected_m = Pose2(3.0, 2.0, 0.45).transform(np.array([[10.0, 0.0]]))
    np.testing.assert_allclose(point_m, expected_m, atol=1e-12)
    motion = Motion.between(before, now)
    start_m = motion.to_map(np.array([0]), np.array([[0.0, 0.0]]), Pose2())
    travelled = now.odom_from_body.inverse() @ before.odom_from_body
    np.testing.assert_allclose(start_m[0], (now.map_from_body @ travelled).as_array()[:2])


def test_without_an_estimate_before_the_rover_stands_still() -> None:
    now: Estimate = make_estimate(100_000_000, np.random.default_rng(1))
    motion = Motion.between(None, now)
    at_m = motion.to_map(np.array([0]), np.array([[0.0, 0.0]]), Pose2())
    np.testing.assert_array_equal(at_m[0], now.map_from_body.as_array()[:2])


def test_beams_without_return_are_not_points() -> None:
    scan = Scan(0, np.array([1.0, np.nan, 30.0, 2.0], np.float32), np.array([0.0, 0.1, 0.2, 0.3]), 0.0, 0, 30.0)
    beams, _, points_m = BeamPoints().of(scan)
    assert beams.tolist() == [0, 3]
    np.testing.assert_allclose(points_m, [[1.0, 0.0], [2.0 * math.cos(0.3), 2.0 * math.sin(0.3)]], rtol=1e-6)


def test_an_ellipse_lies_along_its_largest_variance() -> None:
    turn_rad = 0.7
    rotation = np.array(((np.cos(turn_rad), -np.sin(turn_rad)), (np.sin(turn_rad), np.cos(turn_rad))))
    covariance_m2 = rotation @ np.diag((4.0, 1.0)) @ rotation.T
    half_sizes, quaternions = ellipse_axes(covariance_m2[None], 2.0)
    heading_rad = 2.0 * np.arctan2(quaternions[0, 2], quaternions[0, 3])
    first = np.array((np.cos(heading_rad), np.sin(heading_rad))) * half_sizes[0, 0]
    second = np.array((-np.sin(heading_rad), np.cos(heading_rad))) * half_sizes[0, 1]
    np.testing.assert_allclose(np.outer(first, first) + np.outer(second, second), 4.0 * covariance_m2, rtol=1e-5)


def test_an_extent_grows_and_never_shrinks() -> None:
    extent = Extent().with_points(np.array(((0.0, 40.0), (3.0, 1.0)))).with_points(np.empty((0, 2)))
    assert (extent.low_x_m, extent.high_y_m) == (-10.0, 40.0)
    assert extent.center_m == (0.0, 15.0)


def test_colours_run_from_doubt_to_certainty() -> None:
    colors = mixed((0, 0, 0), (200, 100, 50), np.array((0.0, 0.5, 1.0)))
    assert colors.tolist() == [[0, 0, 0], [100, 50, 25], [200, 100, 50]]


def test_the_assembler_gives_each_tick_when_the_next_begins(records: list[Record]) -> None:
    assembler = TickAssembler()
    assembled_ticks = [assembled for record in records if (assembled := assembler.feed(record)) is not None]
    last = assembler.last()
    assert last is not None
    assert [assembled.tick.seq for assembled in (*assembled_ticks, last)] == list(range(TICKS))
    assert all(assembled.truth is not None and assembled.timing is not None for assembled in assembled_ticks)
