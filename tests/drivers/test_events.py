from drivers.events import LENGTH, REPEAT_NS, EventLog
from drivers.measurements import Severity


def test_a_flood_is_one_event_and_the_next_one_tells_how_many_it_was() -> None:
    log = EventLog("encoders")
    for index in range(1000):
        log.add(index, "crc", "checksums are wrong")
    log.add(REPEAT_NS, "crc", "checksums are wrong")
    assert log.counters["crc"] == 1001
    first, second = log.drain()
    assert first.reason == "checksums are wrong"
    assert second.reason == "checksums are wrong (999 more since the last report)"
    assert log.drain() == ()


def test_other_kinds_are_not_held_back() -> None:
    log = EventLog("encoders")
    log.add(0, "crc", "a")
    log.add(0, "jump", "b")
    assert [event.kind for event in log.drain()] == ["crc", "jump"]


def test_an_undrained_log_stays_small() -> None:
    log = EventLog("encoders")
    for index in range(3 * LENGTH):
        log.add(index, f"kind {index}", "x")
    assert len(log.drain()) == LENGTH


def test_only_trouble_is_remembered_as_trouble_and_told_at_once() -> None:
    troubled_ns: list[int] = []
    log = EventLog("laser", troubled_ns.append)
    log.add(1, "connections", "found", Severity.INFO)
    assert log.trouble == ""
    log.add(2, "link_errors", "pulled")
    log.add(3, "link_errors", "pulled again")
    assert log.trouble == "pulled again"
    assert troubled_ns == [2, 3]
