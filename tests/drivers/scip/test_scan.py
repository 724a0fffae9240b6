import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.measurements import DriverError
from drivers.scip.codec import ChecksumError, FramingError, ScanSizeError, StatusError, encode_message, parse_message
from drivers.scip.commands import ScanRequest
from drivers.scip.framing import MessageStream
from drivers.scip.scan import ECHO_MARK, CodeArray, Echo, ScanDecoder, encode_characters, encode_scan, scan_counters_ms
from tests.support.drivers.recorded_scip import recorded_chunks

ENDLESS = ScanRequest("MD", 0, 1080)
CODES = st.lists(st.integers(0, 2**18 - 1), min_size=1, max_size=200)


def message(request: ScanRequest, codes: CodeArray, counter_ms: int = 4711) -> bytes:
    status = "99" if request.is_stream else "00"
    characters = encode_characters(codes, request.range_characters).tobytes()
    return encode_scan(request.encode(), status, counter_ms, characters)[:-2]


def full_scan(seed: int = 0) -> tuple[CodeArray, bytes]:
    codes = np.random.default_rng(seed).integers(0, 60001, 1081).astype(np.int32)
    return codes, message(ENDLESS, codes)


def test_the_real_sensors_scan_is_decoded() -> None:
    stream = MessageStream()
    raws = [raw.data for stamp_ns, data in recorded_chunks() for raw in stream.feed(stamp_ns, data)]
    scan = ScanDecoder(ScanRequest("ME", 0, 1080, 1, 1, 1)).decode(raws[-1])
    assert scan.counter_ms == 4821609
    assert scan.remaining == 0
    assert scan.codes[:5].tolist() == [45, 48, 49, 50, 49]
    assert scan.intensities is not None
    assert (scan.intensities.min(), scan.intensities.max()) == (137, 16219)  # as the reference says of this capture


def test_a_full_scan_has_the_size_of_the_real_one() -> None:
    assert len(full_scan()[1]) + 2 == 3372


@given(CODES, st.integers(0, 2**24 - 1), st.sampled_from(["MD", "GD", "MD;text"]))
def test_codes_survive_the_round_trip_at_every_length(codes: list[int], counter_ms: int, kind: str) -> None:
    command, _, string = kind.partition(";")
    request = ScanRequest(command, 0, len(codes) - 1, string=string)
    raw = message(request, np.array(codes, np.int32), counter_ms)
    decoder = ScanDecoder(request)
    for scan in (decoder.decode(raw), decoder.decode_message(parse_message(raw))):
        assert scan.codes.tolist() == codes
        assert scan.counter_ms == counter_ms


@given(st.lists(st.integers(0, 4095), min_size=1, max_size=100))
def test_short_codes_survive_the_round_trip(codes: list[int]) -> None:
    request = ScanRequest("MS", 0, len(codes) - 1)
    assert ScanDecoder(request).decode(message(request, np.array(codes, np.int32))).codes.tolist() == codes


@given(st.integers(0, 3369), st.integers(0, 255))
def test_one_wrong_byte_never_gives_wrong_ranges_unseen(place: int, value: int) -> None:
    codes, raw = full_scan()
    damaged = raw[:place] + bytes([value]) + raw[place + 1 :]
    try:
        scan = ScanDecoder(ENDLESS).decode(damaged)
    except DriverError:
        return
    # six bits of sum let a byte through that differs by a multiple of 64, but not as a digit of the code
    assert np.array_equal(scan.codes, codes)


@given(st.binary(max_size=400))
def test_arbitrary_bytes_raise_nothing_outside_the_family(noise: bytes) -> None:
    _, raw = full_scan()
    for request in (ENDLESS, ScanRequest("GE", 0, 30), ScanRequest("ND", 0, 40), ScanRequest("NE", 0, 5)):
        for data in (noise, raw[: len(noise)] + noise, request.encode() + b"\n99b\n" + noise, raw[:26] + noise):
            try:
                ScanDecoder(request).decode(data)
            except DriverError:
                continue


@given(st.lists(st.tuples(st.lists(st.integers(0, 2**18 - 1), min_size=1, max_size=3)), min_size=1, max_size=60))
def test_each_echo_of_a_step_is_told_apart(steps: list[tuple[list[int]]]) -> None:
    echoes = [step[0] for step in steps]
    request = ScanRequest("ND", 0, len(echoes) - 1)
    characters = b""
    for several in echoes:
        coded = [encode_characters(np.array([code], np.int32), 3).tobytes() for code in several]
        characters += bytes([ECHO_MARK]).join(coded)
    raw = encode_scan(request.encode(), "99", 1, characters)[:-2]
    assert ScanDecoder(request, "first").decode(raw).codes.tolist() == [several[0] for several in echoes]
    assert ScanDecoder(request, "last").decode(raw).codes.tolist() == [several[-1] for several in echoes]


@pytest.mark.parametrize(("echo", "expected"), [("first", [100, 300]), ("strongest", [200, 300]), ("last", [150, 300])])
def test_the_strongest_echo_is_the_one_of_highest_intensity(echo: Echo, expected: list[int]) -> None:
    pairs = [(100, 7), (200, 9), (150, 8), (300, 1)]
    coded = [encode_characters(np.array(pair, np.int32), 3).tobytes() for pair in pairs]
    request = ScanRequest("NE", 0, 1)
    raw = encode_scan(request.encode(), "99", 1, b"&".join(coded[:3]) + coded[3])[:-2]
    assert ScanDecoder(request, echo).decode(raw).codes.tolist() == expected


@pytest.mark.parametrize("characters", [b"&000000", b"000&", b"0&00000", b"000&&000", b"000&000&"])
def test_echo_marks_in_impossible_places_are_refused(characters: bytes) -> None:
    request = ScanRequest("ND", 0, 1)
    with pytest.raises((FramingError, ScanSizeError)):
        ScanDecoder(request).decode(encode_scan(request.encode(), "99", 1, characters)[:-2])


def test_a_scan_of_other_size_is_named_with_both_sizes() -> None:
    short = encode_scan(ENDLESS.encode(), "99", 1, b"000" * 1080)[:-2]
    with pytest.raises(ScanSizeError, match="1080 steps, 1081 were asked for"):
        ScanDecoder(ENDLESS).decode(short)


def test_a_wrong_sum_is_found_in_a_full_line_and_in_the_last() -> None:
    _, raw = full_scan()
    for place in (100, len(raw) - 5):
        damaged = raw[:place] + bytes([raw[place] ^ 1]) + raw[place + 1 :]
        with pytest.raises(ChecksumError):
            ScanDecoder(ENDLESS).decode(damaged)


def test_a_status_in_place_of_a_scan_is_told() -> None:
    with pytest.raises(StatusError, match="0L"):
        ScanDecoder(ENDLESS).decode(encode_message(ENDLESS.encode(), "0L")[:-2])


def test_a_scan_that_answers_another_request_is_refused() -> None:
    raw = message(ScanRequest("MD", 0, 1080, 1, 3), full_scan()[0])
    with pytest.raises(FramingError, match="does not answer"):
        ScanDecoder(ENDLESS).decode(raw)


def test_the_remaining_count_is_read_in_front_of_the_string() -> None:
    request = ScanRequest("MD", 0, 2, count=5, string="abc")
    raw = encode_scan(request.echo(3), "99", 1, b"000" * 3)[:-2]
    assert ScanDecoder(request).decode(raw).remaining == 3


@given(counters_ms=st.lists(st.integers(0, 2**24 - 1), max_size=5))
def test_the_counters_of_a_raw_stream_are_those_of_its_scans(counters_ms: list[int]) -> None:
    codes = np.array([1000, 2000, 3000], np.int32)
    request = ScanRequest("MD", 0, 2)
    stream = encode_message(request.encode(), "00") + b"".join(
        message(request, codes, counter_ms) + b"\n\n" for counter_ms in counters_ms
    )
    assert list(scan_counters_ms(stream)) == counters_ms


def test_a_damaged_or_torn_time_line_gives_no_counter() -> None:
    codes = np.array([1000], np.int32)
    whole = message(ScanRequest("MD", 0, 0), codes, 4711) + b"\n\n"
    place = whole.index(b"\n99b\n") + 5
    damaged = whole[:place] + bytes((whole[place] ^ 1,)) + whole[place + 1 :]
    assert list(scan_counters_ms(damaged + whole[: place + 3])) == []
    assert list(scan_counters_ms(damaged + whole)) == [4711]
