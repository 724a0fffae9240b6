from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.scip.codec import FramingError, StatusError
from drivers.scip.commands import SINGLE_COMMANDS, STREAM_COMMANDS, ScanRequest, parse_scan_request

STEPS = st.integers(0, 9999)
STRINGS = st.text("abcXYZ09 ._+@", max_size=16)


@given(
    *(st.sampled_from(STREAM_COMMANDS), STEPS, STEPS, st.integers(0, 99)),
    *(st.integers(0, 9), st.integers(0, 99), STRINGS),
)
def test_a_stream_request_survives_the_round_trip(
    command: str, first: int, last: int, cluster: int, interval: int, count: int, string: str
) -> None:
    request = ScanRequest(command, first, last, cluster, interval, count, string)
    assert parse_scan_request(request.encode()) == request


@given(st.sampled_from(SINGLE_COMMANDS), STEPS, STEPS, st.integers(0, 99))
def test_a_single_request_survives_the_round_trip(command: str, first: int, last: int, cluster: int) -> None:
    request = ScanRequest(command, first, last, cluster)
    assert parse_scan_request(request.encode()) == request
    assert len(request.encode()) == 12


def test_the_request_is_the_one_of_the_specification() -> None:
    assert ScanRequest("MD", 0, 1080, 1, 0, 8, "abc").encode() == b"MD0000108001008;abc"
    assert ScanRequest("MD", 0, 1080, 1, 0, 8, "abc").echo(1) == b"MD0000108001001;abc"


@pytest.mark.parametrize(
    ("line", "status"),
    [
        (b"MD000010800100", "0C"),
        (b"MD00001080010000", "0D"),
        (b"MD0000108001000;" + b"a" * 17, "0G"),
        (b"MD0000108001000;a*b", "0H"),
        (b"MD00001080xx000", "03"),
        (b"MD00001080010xx", "07"),
        (b"GD00001080", "0C"),
        (b"MD00001080\xb2\xb2000", "03"),
    ],
)
def test_a_wrong_request_gets_the_status_of_its_error(line: bytes, status: str) -> None:
    with pytest.raises(StatusError) as caught:
        parse_scan_request(line)
    assert caught.value.status == status


@given(st.binary(max_size=40))
def test_arbitrary_bytes_are_refused_within_the_family(line: bytes) -> None:
    for head in (b"", b"MD", b"GE"):
        with suppress(StatusError, FramingError):
            parse_scan_request(head + line)


@pytest.mark.parametrize(("cluster", "beams"), [(0, 1081), (1, 1081), (2, 541), (3, 361), (99, 11)])
def test_beams_are_counted_with_the_last_part_of_a_cluster(cluster: int, beams: int) -> None:
    assert ScanRequest("MD", 0, 1080, cluster).beams == beams
