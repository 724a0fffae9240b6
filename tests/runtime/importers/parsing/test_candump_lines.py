"""Each form in which candump writes a frame is read, and nothing else."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.canbus.frame import ERROR, EXTENDED, FD, REMOTE
from runtime.importers.parsing.candump_lines import candump_line

DATA = bytes.fromhex("2A366C2BBA")


@pytest.mark.parametrize(
    ("line", "number", "data", "flags"),
    [
        ("(1436509052.249713) can0 044#2A366C2BBA", 0x44, DATA, 0),
        ("(1436509052.249713) can0 044#2a366c2bba R", 0x44, DATA, 0),
        ("(1436509052.249713) can0 044#2A.36.6C.2B.BA", 0x44, DATA, 0),
        ("(1436509052.249713) can0 00000044#2A366C2BBA", 0x44, DATA, EXTENDED),
        ("(1436509052.249713) can0 20000044#2A366C2BBA", 0x44, DATA, ERROR),
        ("(1436509052.249713) can0 044#R", 0x44, b"", REMOTE),
        ("(1436509052.249713) can0 044##12A366C2BBA", 0x44, DATA, FD),
        ("(1436509052.249713) can0 044#", 0x44, b"", 0),
        (" (1436509052.249713)  can0  044   [5]  2A 36 6C 2B BA", 0x44, DATA, 0),
        (" (1436509052.249713)  can0  044   [5]  2A 36 6C 2B BA   '*6l+.'", 0x44, DATA, 0),
        (" (1436509052.249713)  can0  RX - -  044   [5]  2A 36 6C 2B BA", 0x44, DATA, 0),
        (" (1436509052.249713)  can0  00000044   [5]  2A 36 6C 2B BA", 0x44, DATA, EXTENDED),
        (" (1436509052.249713)  can0  044   [0]  remote request", 0x44, b"", REMOTE),
    ],
)
def test_a_line_is_read(line: str, number: int, data: bytes, flags: int) -> None:
    seconds, channel, frame = candump_line(line)
    assert (seconds, channel) == (1436509052.249713, "can0")
    assert (frame.arbitration_id, frame.data, frame.flags) == (number, data, flags)


def test_a_date_is_a_time() -> None:
    seconds, _, _ = candump_line(" (2015-07-10 06:17:32.249713)  can0  044   [1]  2A")
    assert seconds == pytest.approx(1436509052.249713)


@pytest.mark.parametrize(
    "line",
    [
        "",
        "  can0  044   [5]  2A 36 6C 2B BA",
        "(1436509052.2) can0 044#2A3",
        "(1436509052.2) can0 44#2A36",
        "(1436509052.2) can0 044#2A366C2BBA2A366C2BBA",
        "(1436509052.2)  can0  044   [5]  2A 36",
        "(nan) can0 044#2A",
        "(2015-07-99 06:17) can0 044#2A",
    ],
)
def test_a_line_that_is_none_says_why(line: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        candump_line(line)


@given(st.text(alphabet="()0123456789.can# ABCDEFR[]-:'", max_size=60))
def test_any_text_is_a_frame_or_a_reason(text: str) -> None:
    try:
        _, _, frame = candump_line(text)
    except ValueError:
        return
    assert len(frame.data) <= 64
