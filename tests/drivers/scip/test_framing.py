import time
from itertools import pairwise

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from drivers.scip.framing import MESSAGE_BYTES, MessageStream, RawMessage

MESSAGES = [b"QT\n00P", b"MD0000108001000\n99b\n00000\n" + b"0" * 70, b"BM\n02R"]


def cut(data: bytes, places: list[int]) -> list[bytes]:
    edges = [0, *sorted(place % (len(data) + 1) for place in places), len(data)]
    return [data[first:last] for first, last in pairwise(edges)]


@given(st.lists(st.sampled_from(MESSAGES), max_size=8), st.lists(st.integers(0, 10000), max_size=12))
def test_messages_do_not_depend_on_how_they_were_read(messages: list[bytes], places: list[int]) -> None:
    stream = MessageStream()
    data = b"".join(message + b"\n\n" for message in messages)
    found = [raw.data for chunk in cut(data, places) for raw in stream.feed(0, chunk)]
    assert found == messages
    assert stream.pending_bytes == 0


@given(st.binary(max_size=200), st.lists(st.integers(0, 400), max_size=6))
@example(b"\n\n\n", [])
@example(b"QT\n", [])
def test_after_arbitrary_bytes_all_but_the_first_message_are_found(noise: bytes, places: list[int]) -> None:
    stream = MessageStream()
    data = noise + b"".join(message + b"\n\n" for message in MESSAGES)
    found = [raw.data for chunk in cut(data, places) for raw in stream.feed(0, chunk)]
    assert found[-2:] == MESSAGES[1:]


@given(st.integers(1, 5), st.sampled_from([0, 1, 7, 4096, MESSAGE_BYTES - 1, MESSAGE_BYTES, MESSAGE_BYTES + 1]))
def test_memory_is_bounded_and_the_stream_is_in_step_after_one_message(blocks: int, extra: int) -> None:
    stream = MessageStream()
    for size in [MESSAGE_BYTES + 1] * blocks + [extra]:
        assert stream.feed(0, b"x" * size) == []
        assert stream.pending_bytes <= MESSAGE_BYTES
    found = stream.feed(0, b"\n\n" + MESSAGES[0] + b"\n\n")
    assert [raw.data for raw in found] == [MESSAGES[0]]
    assert stream.discarded_bytes >= blocks * MESSAGE_BYTES + extra


def test_a_pair_of_line_feeds_cut_where_the_buffer_overflows_is_still_seen() -> None:
    stream = MessageStream()
    stream.feed(0, b"x" * MESSAGE_BYTES)
    stream.feed(0, b"\n")
    found = stream.feed(0, b"\n" + MESSAGES[0] + b"\n\n")
    assert [raw.data for raw in found] == [MESSAGES[0]]


def test_a_message_has_the_stamp_of_its_first_byte() -> None:
    stream = MessageStream()
    assert stream.feed(10, b"QT\n0") == []
    found = stream.feed(20, b"0P\n\nBM\n02R\n\nVV")
    assert [(raw.stamp_ns, raw.data) for raw in found] == [(10, b"QT\n00P"), (20, b"BM\n02R")]
    assert [raw.stamp_ns for raw in stream.feed(30, b"\n00P\n\n")] == [20]


def test_a_new_link_forgets_what_the_old_one_left_half() -> None:
    stream = MessageStream()
    stream.feed(0, b"MD00001080")
    stream.reset()
    assert [raw.data for raw in stream.feed(0, b"QT\n00P\n\n")] == [b"QT\n00P"]


def test_a_byte_of_garbage_costs_the_same_however_much_of_it_waits() -> None:
    """Looking at all that waits for each byte would make the last bytes cost a thousand times the first."""
    stream, cost_s = MessageStream(), []
    for _ in range(64):
        began_s = time.thread_time()
        for _ in range(MESSAGE_BYTES // 32):
            stream.feed(0, b"x")
        cost_s.append(time.thread_time() - began_s)
    assert min(cost_s[-16:]) < 20.0 * min(cost_s[:16])


def test_line_feeds_alone_are_one_end_and_not_a_message_of_nothing_each(monkeypatch: pytest.MonkeyPatch) -> None:
    stream, closed = MessageStream(), list[bytes]()
    close = stream._close

    def counted(raw: bytes, messages: list[RawMessage]) -> None:
        closed.append(raw)
        close(raw, messages)

    monkeypatch.setattr(stream, "_close", counted)
    assert stream.feed(0, b"\n" * MESSAGE_BYTES) == []
    assert [raw.data for raw in stream.feed(0, b"QT\n00P" + b"\n" * 1000)] == [b"QT\n00P"]
    assert len(closed) == 2


def test_a_terminal_that_puts_a_carriage_return_before_each_line_feed_changes_nothing() -> None:
    stream = MessageStream()
    read = b"QT\r\n00P\r\n\r", b"\nVV\r\n00P\r\n\r\n"
    assert [message.data for data in read for message in stream.feed(0, data)] == [b"QT\n00P", b"VV\n00P"]
