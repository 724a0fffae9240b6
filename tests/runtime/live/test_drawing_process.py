"""The drawing process gets every record, and its death or deafness costs only the picture."""

import io
import itertools
import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.live.drawing_process import ReviewProcess, processor_ticks
from runtime.messages.pipe import read_frames, write_frame
from runtime.messages.tick import Record
from runtime.settings.review import ReviewSettings
from runtime.source_tree import ROOT
from runtime.tick import SinkHealth
from tests.support.drivers.raising import raise_in
from tests.support.runtime.drawn_drive import MOUNT, drive
from tests.support.zenoh.wire import until

pytestmark = pytest.mark.usefixtures("patient_drawing")
records_strategy = st.lists(st.builds(Record, st.text(max_size=20), st.integers(-(2**63), 2**63 - 1), st.binary()))


@given(records_strategy, st.integers(0, 10))
def test_frames_come_back_and_a_cut_one_is_left_out(records: list[Record], cut: int) -> None:
    stream = io.BytesIO()
    for record in records:
        write_frame(stream, record)
    whole = stream.getvalue()
    assert list(read_frames(io.BytesIO(whole))) == records
    if records and cut:
        assert list(read_frames(io.BytesIO(whole[:-1]))) == records[:-1]


def test_a_run_is_drawn_in_another_process_as_it_would_be_here(tmp_path: Path) -> None:
    from runtime.review.writer import ReviewWriter

    records = [record for tick in drive(30) for record in tick]
    (tmp_path / "here").mkdir()
    (tmp_path / "there").mkdir()
    process = ReviewProcess(tmp_path / "there" / "review.rrd", ReviewSettings(), MOUNT)
    writer = ReviewWriter(tmp_path / "here" / "review.rrd", ReviewSettings(), MOUNT)
    for record in records:
        process.feed(record)
        writer.feed(record)
    assert until(lambda: (tmp_path / "there" / "review.rrd").exists()), "a busy machine takes its time"
    process.close()
    writer.close()
    here, there = ((tmp_path / where / "review.rrd").stat().st_size for where in ("here", "there"))
    assert abs(here - there) < 0.02 * here
    assert (process.health().dropped, process.health().trouble) == (0, "")


def test_topics_that_are_not_drawn_are_not_sent(tmp_path: Path) -> None:
    process = ReviewProcess(tmp_path / "review.rrd", ReviewSettings())
    os.kill(process.pid, signal.SIGSTOP)
    for _ in range(500):
        process.feed(Record("/raw/can", 0, b"x" * 10_000))
    assert process.health().depth == 0
    os.kill(process.pid, signal.SIGCONT)
    process.close()


def test_a_dead_child_is_a_state_with_its_reason(tmp_path: Path) -> None:
    process = ReviewProcess(tmp_path / "no such folder" / "review.rrd", ReviewSettings())

    def fed() -> bool:
        process.feed(Record("/gap", 0, bytes(100)))
        return process.health().trouble != ""

    assert until(fed)
    assert "cannot be written" in process.health().trouble
    dropped = process.health().dropped
    assert dropped >= 1
    process.feed(Record("/tick", 0, b""))
    assert process.health() == SinkHealth(0, dropped + 1, process.health().trouble)
    process.close()


def test_whatever_is_raised_in_its_thread_ends_the_picture_and_is_told(tmp_path: Path) -> None:
    process = ReviewProcess(tmp_path / "review.rrd", ReviewSettings())
    raise_in("review")

    def fed() -> bool:
        process.feed(Record("/gap", 0, bytes(100)))
        return process.health().trouble != ""

    assert until(fed)
    assert "the drawing process has ended (OutOfNowhere() File" in process.health().trouble
    process.close()


def test_a_deaf_child_costs_records_and_neither_feed_nor_close(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("runtime.live.drawing_process.WRITE_S", 0.2)
    monkeypatch.setattr("runtime.live.drawing_process.STALLED_S", 0.2)
    monkeypatch.setattr("runtime.live.drawing_process.QUEUE", 100)
    process = ReviewProcess(tmp_path / "review.rrd", ReviewSettings())
    os.kill(process.pid, signal.SIGSTOP)
    for _ in range(400):
        process.feed(Record("/scan", 0, bytes(4000)))
    assert process.health().dropped > 200, "nobody waited for it"
    process.close()
    assert "not finished" in process.health().trouble


@pytest.mark.parametrize(
    ("most_s", "latest_s", "trouble"),
    [
        (600.0, math.inf, ""),
        (0.0, math.inf, "review.rrd was not finished in time"),
        (600.0, 0.0, "review.rrd was not finished in time"),
    ],
)
def test_a_slow_child_is_waited_for_while_it_works_and_within_bounds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most_s: float, latest_s: float, trouble: str
) -> None:
    """It takes a second to begin: many times what one gets that does nothing."""
    monkeypatch.setattr("runtime.live.drawing_process.DRAW_S", most_s)
    monkeypatch.setattr("runtime.live.drawing_process.STALLED_S", 0.1)
    ticks = itertools.count()  # as of a machine where it always gets a little done
    monkeypatch.setattr("runtime.live.drawing_process.processor_ticks", lambda pid: next(ticks))
    process = ReviewProcess(tmp_path / "review.rrd", ReviewSettings())
    for tick in drive(10):
        for record in tick:
            process.feed(record)
    assert until((tmp_path / "review.rrd").exists, 600.0)
    process.finish_by(latest_s)
    process.close()
    assert process.health().trouble.startswith(trouble)
    assert bool(process.health().trouble) == bool(trouble)
    assert (tmp_path / "review.rrd").exists() == (trouble == ""), "half a picture would be taken for a whole one"


def test_work_of_a_process_is_counted_and_stands_still_while_it_is_stopped() -> None:
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as busy:
        begun = processor_ticks(busy.pid)
        assert until(lambda: processor_ticks(busy.pid) > begun)
        os.kill(busy.pid, signal.SIGSTOP)
        assert until(lambda: Path(f"/proc/{busy.pid}/stat").read_text().rpartition(")")[2].split()[0] == "T")
        stopped = processor_ticks(busy.pid)
        assert not until(lambda: processor_ticks(busy.pid) > stopped, 0.2)
        busy.kill()
    assert processor_ticks(busy.pid) == 0


def test_the_loops_process_never_imports_rerun() -> None:
    code = "import sys, runtime.live.drawing_process, runtime.review.viewer; assert 'rerun' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)
