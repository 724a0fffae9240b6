"""What one drawing process hands to the next comes back whole, and is data only."""

from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from drivers.measurements import Severity
from drivers.scip.scan import encode_scan
from runtime.messages.tick import LaserBytes, Record, encode_laser_bytes
from runtime.review.clock_offset import LaserClockOffset
from runtime.review.columns import ReviewColumns
from runtime.review.drawing_state import DrawingState, draw_end, draw_start
from runtime.review.ticks import TickAssembler
from runtime.review.writer import ReviewWriter
from runtime.settings.review import ReviewSettings
from slam.pose import Pose2
from tests.runtime.review.test_rebuild import Drawn
from tests.support.runtime.drawn_drive import MOUNT, drive

WRAP_MS = 1 << 24


def scan_record(second: float, drift: float = 1e-4) -> Record:
    counter_ms = (WRAP_MS - 3000 + round(second * 1e3 * (1.0 - drift))) % WRAP_MS
    data = encode_scan(b"MD0000108001000", "99", counter_ms, b"0" * 8)
    return encode_laser_bytes(LaserBytes(round((100.0 + second) * 1e9), False, data))


def test_the_state_of_a_writer_comes_back_whole(tmp_path: Path) -> None:
    writer = ReviewWriter(tmp_path / "review.rrd", ReviewSettings(), MOUNT)
    for tick in drive(25):
        for record in tick:
            writer.feed(record)
    writer.close()
    first = DrawingState.from_bytes(writer.carried())
    assert first.drawn == 25
    assert first.start_ns == 5_000_000_000
    assert set(first.path_ends_m) == {"SLAM", "odometry", "truth"}
    assert first.before is not None
    assert first.landmarks is not None
    again = DrawingState.from_bytes(first.to_bytes())
    assert again.to_bytes() == first.to_bytes() == writer.carried()
    np.testing.assert_array_equal(again.landmarks.means_m, first.landmarks.means_m)  # type: ignore[union-attr]


def test_a_fresh_state_comes_back_too() -> None:
    again = DrawingState.from_bytes(DrawingState().to_bytes())
    assert (again.start_ns, again.before, again.clock.state, again.path_ends_m) == (None, None, None, {})


def test_the_clock_goes_on_over_a_wrap_as_if_nobody_had_taken_over() -> None:
    records = [scan_record(0.1 * count) for count in range(100)]
    clock = LaserClockOffset()
    whole = [clock.feed(record) for record in records]
    state = DrawingState()
    carried = []
    for record in records:
        carried.append(state.clock.feed(record))
        state = DrawingState.from_bytes(state.to_bytes())
    assert carried == whole
    assert sum(offset is not None for offset in whole) >= 9


def test_a_tick_whose_scan_was_lost_on_the_way_is_said_with_the_next_one() -> None:
    assembler = TickAssembler()
    ticks = list(drive(3))
    told = []
    for number, tick in enumerate(ticks):
        for record in tick:
            if number == 1 and record.topic == "/scan":
                continue
            if (assembled := assembler.feed(record)) is not None:
                told.append(assembled)
    last = assembler.last()
    assert last is not None
    assert [assembled.tick.seq for assembled in (*told, last)] == [0, 2]
    (event,) = last.losses
    assert (event.source, event.kind, event.severity) == ("review", "incomplete", Severity.WARN)
    assert "infant review" in event.reason


@pytest.mark.parametrize(("end_m", "words"), [((0.4, 0.3), {"start and end"}), ((9.0, 3.0), {"start", "end"})])
def test_a_run_that_ends_where_it_began_has_one_name_there(
    end_m: tuple[float, float], words: set[str], tmp_path: Path
) -> None:
    recording, state = rr.RecordingStream("infant"), DrawingState()
    recording.save(tmp_path / "ends.rrd")
    columns = ReviewColumns(recording)
    draw_start(columns, state, Pose2(0.0, 0.0, 0.0))
    columns.at(10_000_000_000, 100)
    draw_end(columns, state, Pose2(*end_m, 0.0))
    columns.flush()
    recording.disconnect()
    drawn = Drawn(tmp_path / "ends.rrd")
    names = [drawn.values[(f"/map/{name}", "labels")][-1] or [] for name in ("start", "end")]
    assert {label for row in names for label in row} == words
