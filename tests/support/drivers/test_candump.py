from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.canbus.frame import ERROR, EXTENDED, FD, REMOTE, CanFrame
from drivers.measurements import ProtocolError
from tests.support.drivers.candump import candump_frame, candump_line, read_candump


@given(
    microseconds=st.integers(0, 2**51),
    number=st.integers(0, 0x7FF),
    data=st.binary(max_size=8),
    flags=st.sampled_from([0, EXTENDED, REMOTE, ERROR, FD, EXTENDED | REMOTE, EXTENDED | FD]),
)
def test_what_is_written_is_read(microseconds: int, number: int, data: bytes, flags: int) -> None:
    frame = CanFrame(microseconds * 1000, number, b"" if flags & REMOTE else data, flags)
    assert candump_frame(candump_line(frame)) == frame


def test_an_error_frame_keeps_its_class() -> None:
    frame = candump_frame("(1700000010.001000) can0 20000004#0030000000000000")
    assert frame == CanFrame(1_700_000_010_001_000_000, 4, bytes((0, 0x30, 0, 0, 0, 0, 0, 0)), ERROR)


def test_a_line_of_another_kind_is_named(tmp_path: Path) -> None:
    path = tmp_path / "x.log"
    path.write_text("(1.000000) can0 181#00\n\ncan0  181   [8]  00 FF\n")
    with pytest.raises(ProtocolError, match=r"x\.log, line 3: .* is no line of candump -l"):
        list(read_candump(path))


def test_the_real_recordings_are_read_whole(recorded_data: Callable[[str], Path]) -> None:
    assert sum(1 for _ in read_candump(recorded_data("can_civic_typer") / "candump.log")) == 28835
    frames = list(read_candump(recorded_data("can_encoder") / "infant_candump.log"))
    assert len(frames) == 1001
    assert [frame for frame in frames if frame.flags & ERROR] == [frames[-1]]
