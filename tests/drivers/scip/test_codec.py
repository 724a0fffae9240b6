from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.scip.codec import (
    STATUS_MEANINGS,
    ChecksumError,
    FramingError,
    Message,
    ScipError,
    decode_number,
    encode_key_values,
    encode_legacy_message,
    encode_message,
    encode_number,
    encode_time,
    is_fault,
    is_transient,
    parse_key_values,
    parse_message,
    parse_time,
    status_meaning,
    summed,
    unsummed,
)
from drivers.scip.framing import MessageStream
from tests.support.drivers.recorded_scip import recorded_chunks

PRINTABLE = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), max_size=40)
STATUS_LINES = "00P 01Q 02R 03S 04T 05U 06V 07W 10Q 98a 99b 0Aa 0Bb 0Cc 0Dd 0Ee 0Ff 0Gg 0Hh 0Ii 0Ll 0Mm"


def recorded_messages() -> list[Message]:
    stream = MessageStream()
    raws = [raw for stamp_ns, data in recorded_chunks() for raw in stream.feed(stamp_ns, data)]
    assert stream.pending_bytes == 0
    return [parse_message(raw.data) for raw in raws]


def test_every_message_of_the_real_sensor_is_read() -> None:
    messages = recorded_messages()
    assert [message.echo for message in messages] == [
        *(b"VV", b"VV", b"PP", b"II", b"BM", b"CR00", b"VV", b"PP", b"II"),
        *(b"ME0000108001101", b"ME0000108001100"),
    ]
    assert [message.status for message in messages] == ["00"] * 4 + ["02", "04"] + ["00"] * 4 + ["99"]


def test_every_line_of_the_real_sensor_has_its_sum() -> None:
    messages = recorded_messages()
    described = [parse_key_values(message) for message in messages if message.echo in (b"VV", b"PP", b"II")]
    assert sum(len(values) for values in described) == 3 * 5 + 2 * 8 + 2 * 7
    assert described[0]["FIRM"] == "P.1.05(17/Apr./2009)"
    assert described[3]["SCSP"] == "Initial(2400[rpm])<-Default setting by user"
    lines = messages[-1].lines
    assert parse_time(lines[0]) == 4821609
    assert sum(len(unsummed(line)) for line in lines[1:]) == 1081 * 6


def test_the_real_sensors_replies_are_written_byte_for_byte() -> None:
    stream = MessageStream()
    for stamp_ns, data in recorded_chunks():
        for raw in stream.feed(stamp_ns, data):
            message = parse_message(raw.data)
            body = b""
            if message.echo in (b"VV", b"PP", b"II"):
                body = encode_key_values(parse_key_values(message))
            elif message.status == "99":
                body = b"".join(summed(unsummed(line)) for line in message.lines)
            assert encode_message(message.echo, message.status, body) == raw.data + b"\n\n"


@pytest.mark.parametrize("line", STATUS_LINES.split())
def test_status_lines_carry_the_sums_of_the_specification(line: str) -> None:
    assert summed(line[:2].encode()) == line.encode() + b"\n"


@pytest.mark.parametrize(
    ("value", "characters"), [(1234, b"CB"), (5432, b"1Dh"), (16000000, b"m2@0"), (2**24 - 1, b"oooo"), (0, b"0000")]
)
def test_numbers_are_coded_as_in_the_specification(value: int, characters: bytes) -> None:
    assert encode_number(value, len(characters)) == characters
    assert decode_number(characters) == value


@given(st.integers(0, 2**24 - 1))
def test_a_number_survives_the_round_trip(value: int) -> None:
    assert decode_number(encode_number(value, 4)) == value
    assert parse_time(encode_time(value)[:-1]) == value


@pytest.mark.parametrize(("value", "width"), [(4096, 2), (-1, 3), (2**18, 3)])
def test_a_number_that_does_not_fit_is_refused(value: int, width: int) -> None:
    with pytest.raises(ValueError, match="does not fit"):
        encode_number(value, width)


@given(st.dictionaries(PRINTABLE.filter(lambda key: ":" not in key), PRINTABLE, min_size=1, max_size=8))
def test_key_values_survive_the_round_trip_whatever_their_text(values: dict[str, str]) -> None:
    raw = encode_message(b"VV", "00", encode_key_values(values))
    assert parse_key_values(parse_message(raw[:-2])) == values


def test_sums_over_the_semicolon_or_up_to_the_arrow_are_accepted_too() -> None:
    # ':' + ';' shifts the sum by 0x3b; other firmware sums only what stands before the arrow
    with_semicolon = b"STAT:x;" + summed(b"STAT:x;")[-2:-1]
    before_arrow = b"SCSP:Initial<-Default;" + summed(b"SCSP:Initial")[-2:-1]
    message = Message(b"II", "00", (with_semicolon, before_arrow))
    assert parse_key_values(message) == {"STAT": "x", "SCSP": "Initial<-Default"}


def test_a_key_value_line_with_a_wrong_sum_is_refused() -> None:
    with pytest.raises(ChecksumError, match="wrong checksum"):
        parse_key_values(Message(b"PP", "00", (b"DMIN:24;7",)))


def test_a_status_line_of_one_character_is_scip_1_1() -> None:
    message = parse_message(encode_legacy_message(b"QT", "E")[:-2])
    assert message.legacy
    assert message.status == "E"


@pytest.mark.parametrize(
    ("raw", "error"),
    [
        (b"QT", FramingError),
        (b"QT\n00Q", ChecksumError),
        (b"QT\n00", FramingError),
        (b"QT\n\xff\xff\xff", FramingError),
        (b"\xff\n00P", FramingError),
    ],
)
def test_a_damaged_message_is_refused_with_its_reason(raw: bytes, error: type[ScipError]) -> None:
    with pytest.raises(error):
        parse_message(raw)


@given(st.binary(max_size=300))
def test_arbitrary_bytes_raise_nothing_outside_the_family(raw: bytes) -> None:
    with suppress(ScipError):
        parse_key_values(parse_message(raw))
    for parse in (unsummed, decode_number, parse_time):
        with suppress(ScipError):
            parse(raw)


def test_only_reboots_end_a_fault_and_a_fault_is_never_transient() -> None:
    faults = {status for status in [*STATUS_MEANINGS, *(f"{code:02d}" for code in range(100))] if is_fault(status)}
    assert faults == {"0L", *(f"{code}" for code in range(50, 98))}
    assert not any(is_transient(status) for status in faults)
    assert status_meaning("66") == "hardware trouble"
    assert status_meaning("05") == "a parameter is refused"
