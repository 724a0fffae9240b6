from collections import deque

import pytest

from drivers.laser.client import ScipClient, find_reply
from drivers.measurements import LinkError

MS_NS = 1_000_000


class Script:
    """A link that answers each read with the next piece; time passes only while it waits."""

    def __init__(self, pieces: list[bytes]) -> None:
        self._pieces = deque(pieces)
        self.now_ns = 0
        self.written: list[bytes] = []
        self.tapped: list[tuple[int, bool, bytes]] = []

    def read(self, timeout_s: float) -> bytes:
        if self._pieces:
            self.now_ns += MS_NS
            return self._pieces.popleft()
        self.now_ns += round(timeout_s * 1e9)
        return b""

    def write(self, data: bytes) -> None:
        self.written.append(data)

    def close(self) -> None:
        pass

    def laser_bytes(self, stamp_ns: int, sent: bool, data: bytes) -> None:
        self.tapped.append((stamp_ns, sent, data))

    def can_frame(self, stamp_ns: int, arbitration_id: int, flags: int, data: bytes) -> None:
        raise AssertionError


def talk_over(script: Script, is_closing: bool = False) -> ScipClient:
    return ScipClient(script, script, lambda: script.now_ns, lambda: is_closing)


def test_a_reply_is_found_behind_scans_that_were_on_their_way() -> None:
    script = Script([b"MD0000108001000\n99b\n00000\n000", b"0\n\nVV\n00P\n\nQT\n0", b"0P\n\n"])
    reply = talk_over(script).ask(b"QT", 1.0)
    assert reply is not None
    assert (reply.echo, reply.status) == (b"QT", "00")
    assert script.written == [b"QT\n"]


def test_a_reply_is_found_behind_the_head_of_a_torn_message() -> None:
    reply = find_reply(b"MD0000108001000\n99b\n00000\n0000QT\n00P", b"QT")
    assert reply is not None
    assert reply.status == "00"


@pytest.mark.parametrize("raw", [b"VV\n00P", b"QT\n00Q", b"QT", b"", b"QT\n64 characters of data\nx"])
def test_what_is_no_reply_is_not_taken_for_one(raw: bytes) -> None:
    assert find_reply(raw, b"QT") is None


def test_no_reply_is_none_after_the_time_that_was_given() -> None:
    script = Script([b"noise\n\n"] * 3)
    assert talk_over(script).ask(b"QT", 0.5) is None
    assert script.now_ns == pytest.approx(500 * MS_NS, abs=MS_NS)


def test_draining_ends_with_silence_and_not_later_than_asked() -> None:
    short, endless = Script([b"x"] * 5), Script([b"x"] * 10_000)
    talk_over(short).drain(1.0)
    assert short.now_ns == pytest.approx(145 * MS_NS, abs=MS_NS)
    talk_over(endless).drain(1.0)
    assert endless.now_ns == pytest.approx(1000 * MS_NS, abs=MS_NS)


def test_every_byte_of_both_directions_goes_to_the_tap_with_its_time() -> None:
    script = Script([b"QT\n", b"00P\n\n"])
    talk_over(script).ask(b"QT", 1.0)
    assert script.tapped == [(0, True, b"QT\n"), (MS_NS, False, b"QT\n"), (2 * MS_NS, False, b"00P\n\n")]


def test_a_closing_driver_asks_nothing_more() -> None:
    with pytest.raises(LinkError, match="closing"):
        talk_over(Script([b"QT\n00P\n\n"]), is_closing=True).ask(b"QT", 1.0)


@pytest.mark.parametrize(("piece", "least", "most"), [(b"x", 3_500_000, 5_000_000), (b"\n", 20_000, 400_000)])
def test_a_link_that_floods_has_to_wait(piece: bytes, least: int, most: int) -> None:
    """It took most of a core for as long as it went on, and all of it went into the record."""
    script = Script([piece * 65536] * 400)

    def pause(seconds: float) -> None:
        script.now_ns += round(seconds * 1e9)

    client = ScipClient(script, None, lambda: script.now_ns, lambda: False, pause)
    while script.now_ns < 1_000_000_000:
        client.receive(0.1)
    assert least < client.received_bytes < most


def test_the_fastest_laser_never_waits() -> None:
    script = Script([b"x" * 45_000] * 40)  # multi-echo with intensities, each scan in one piece
    client = ScipClient(script, None, lambda: script.now_ns, lambda: False, lambda _: pytest.fail("it waited"))
    for _ in range(40):
        script.now_ns += 24 * MS_NS
        client.receive(0.1)
