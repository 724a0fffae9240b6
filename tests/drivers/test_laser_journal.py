from drivers.laser_journal import AroundErrors, LaserJournal
from drivers.measurements import Severity

SECOND_NS = 10**9


class Record:
    def __init__(self) -> None:
        self.seconds: list[float] = []

    def laser_bytes(self, stamp_ns: int, sent: bool, data: bytes) -> None:
        self.seconds.append(stamp_ns / SECOND_NS)

    def can_frame(self, stamp_ns: int, arbitration_id: int, flags: int, data: bytes) -> None:
        raise AssertionError


def test_bytes_are_kept_from_two_seconds_before_an_error_until_two_seconds_after() -> None:
    record = Record()
    around = AroundErrors(record)
    for half in range(40):
        around.laser_bytes(half * SECOND_NS // 2, False, b"x")
        if half == 20:
            around.error(half * SECOND_NS // 2)
    assert record.seconds == [8 + half / 2 for half in range(9)]


def test_a_second_error_lengthens_the_record_without_repeating_a_byte() -> None:
    record = Record()
    around = AroundErrors(record)
    for half in range(40):
        around.laser_bytes(half * SECOND_NS // 2, False, b"x")
        if half in (20, 22):
            around.error(half * SECOND_NS // 2)
    assert record.seconds == [8 + half / 2 for half in range(11)]


def test_every_occurrence_is_counted_and_one_a_second_is_told() -> None:
    journal = LaserJournal()
    for tenth in range(25):
        journal.note(tenth * SECOND_NS // 10, "checksum_errors", "a sum is wrong", Severity.WARN)
    assert journal.counters["checksum_errors"] == 25
    assert [event.reason for event in journal.drain()] == [
        "a sum is wrong",
        "a sum is wrong (and 9 more before)",
        "a sum is wrong (and 9 more before)",
    ]
    assert journal.drain() == ()


def test_events_that_nobody_takes_do_not_pile_up() -> None:
    journal = LaserJournal()
    for second in range(1000):
        journal.note(second * SECOND_NS, "silences", f"{second}", Severity.WARN)
    events = journal.drain()
    assert len(events) == 256
    assert events[-1].reason == "999"


def test_only_trouble_is_remembered_as_trouble() -> None:
    journal = LaserJournal()
    journal.note(0, "connections", "found")
    assert journal.trouble == ""
    journal.note(0, "link_errors", "pulled", Severity.WARN)
    assert journal.trouble == "pulled"
