from drivers.laser.around_errors import AroundErrors

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
