import numpy as np
import pytest

from drivers.events import EventLog
from drivers.laser import scans
from drivers.laser.clock import LaserClock
from drivers.laser.scans import ScanAssembly
from drivers.measurements import Scan
from drivers.scip.codec import ScanSizeError, StatusError, encode_message
from drivers.scip.commands import ScanRequest
from drivers.scip.framing import RawMessage
from drivers.scip.scan import encode_characters, encode_scan
from drivers.settings.laser import LaserSettings
from drivers.simulated.laser.profiles import PROFILES

REQUEST = ScanRequest("MD", 0, 1080)
PERIOD_MS = 100
DELAY_MS = 75


class Bench:
    """An assembly fed with messages of a laser that began to turn at host time 0."""

    def __init__(self, request: ScanRequest = REQUEST, **settings: object) -> None:
        self.events = EventLog("laser")
        self.codes: dict[str, int] = {}
        self.request = request
        self.assembly = ScanAssembly(
            LaserSettings.model_validate(settings),
            PROFILES["UTM-X001S"].parameters,
            request,
            LaserClock(200.0),
            self.events,
            self.codes,
        )
        self._rng = np.random.default_rng(0)

    def message(self, number: int, codes: list[int] | None = None, counter_ms: int | None = None) -> bytes:
        values = np.array(codes) if codes is not None else self._rng.integers(100, 9000, self.request.beams)
        characters = encode_characters(values.astype(np.int32), self.request.range_characters).tobytes()
        counter_ms = PERIOD_MS * number if counter_ms is None else counter_ms
        return encode_scan(self.request.encode(), "99", counter_ms, characters)[:-2]

    def take(self, number: int, raw: bytes | None = None, late_ms: int = 0) -> Scan | None:
        arrival_ns = (PERIOD_MS * number + DELAY_MS + late_ms) * 1_000_000
        return self.assembly.take(RawMessage(arrival_ns, self.message(number) if raw is None else raw))


def test_error_codes_are_no_ranges_and_are_counted_by_meaning() -> None:
    bench = Bench()
    scan = bench.take(0, bench.message(0, [1, 2, 2, 3, 22, 60001, 23, 60000] + [1000] * 1073))
    assert scan is not None
    assert np.isnan(scan.ranges_m[:6]).all()
    assert scan.ranges_m[6:8] == pytest.approx([0.023, 60.0])
    assert bench.codes == {
        "no_range_too_far": 2,
        "no_range_too_near": 2,
        "no_range_interference": 1,
        "no_range_other": 1,
    }


def test_every_millimetre_survives_as_float32() -> None:
    bench = Bench(ScanRequest("MD", 0, 1080))
    for first in range(23, 60001 - 1081, 1081):
        codes = np.arange(first, first + 1081)
        scan = bench.take(first, bench.message(first, codes.tolist()))
        assert scan is not None
        assert scan.ranges_m.dtype == np.float32
        assert np.array_equal(np.rint(scan.ranges_m * 1000).astype(int), codes)


@pytest.mark.parametrize(("reference", "expected_ms"), [("step_zero", 12.5), ("behind", 25.0)])
def test_the_stamp_is_that_of_the_first_beam(reference: str, expected_ms: float) -> None:
    bench = Bench(ScanRequest("MD", 180, 900), stamp_reference=reference)  # step 180 comes an eighth of a turn later
    bench.take(0)
    scan = bench.take(1)
    assert scan is not None
    assert scan.stamp_ns / 1e6 == pytest.approx(PERIOD_MS + expected_ms, abs=1.0)


def test_scans_that_are_missing_by_their_stamps_are_counted() -> None:
    bench = Bench()
    for number in (0, 1, 5, 6):
        bench.take(number)
    assert bench.events.counters["dropped_scans"] == 3
    reported = [event.reason for event in bench.events.drain() if event.kind == "dropped_scans"]
    assert reported == ["3 scan(s) missing before this one"]


def test_a_stamp_that_stands_still_is_dropped_and_counted() -> None:
    bench = Bench()
    bench.take(1)
    assert bench.take(2, bench.message(2, counter_ms=100)) is None
    assert bench.events.counters["stale_stamp"] == 1
    assert bench.take(3) is not None


def test_the_same_ranges_again_and_again_are_no_scans(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scans, "FROZEN_SCANS", 3)
    bench = Bench()
    frozen = list(range(100, 1181))
    taken = [bench.take(number, bench.message(number, frozen)) is not None for number in range(6)]
    assert taken == [True, True, True, False, False, False]
    assert bench.take(6) is not None
    assert bench.events.counters["frozen_scans"] == 3


def test_an_empty_field_is_not_frozen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scans, "FROZEN_SCANS", 3)
    bench = Bench()
    assert all(bench.take(number, bench.message(number, [1] * 1081)) is not None for number in range(9))


def test_a_scan_behind_a_torn_message_is_not_lost() -> None:
    bench = Bench()
    bench.take(0)
    torn = bench.message(1)[:1000] + bench.message(2)
    assert bench.take(2, torn) is not None
    assert bench.events.counters["torn_messages"] == 1
    assert bench.events.counters["resynchronisations"] == 1


def test_damage_is_counted_by_kind_and_followed_by_one_resynchronisation() -> None:
    bench = Bench()
    raw = bench.message(0)
    assert bench.take(0, raw[:100] + bytes([raw[100] ^ 1]) + raw[101:]) is None
    assert bench.take(1, b"noise") is None
    assert bench.take(2) is not None
    assert bench.take(3) is not None
    counters = bench.events.counters
    assert (counters["checksum_errors"], counters["framing_errors"], counters["resynchronisations"]) == (1, 1, 1)


def test_what_the_laser_says_in_place_of_a_scan_is_told_apart() -> None:
    bench = Bench()
    assert bench.take(0, encode_message(REQUEST.encode(), "0M")[:-2]) is None
    assert bench.take(0, encode_message(REQUEST.encode(), "00")[:-2]) is None
    with pytest.raises(StatusError):
        bench.take(0, encode_message(REQUEST.encode(), "0L")[:-2])
    with pytest.raises(ScanSizeError):
        bench.take(0, encode_scan(REQUEST.encode(), "99", 0, b"000" * 1080)[:-2])
    assert bench.events.counters["status_0M"] == 1
    assert bench.events.counters["wrong_size"] == 1


def test_a_slow_laser_is_told_once() -> None:
    bench = Bench()
    for number in range(0, 90, 3):
        bench.take(number)
    assert bench.events.counters["slow"] == 1


def test_a_late_message_is_told_and_keeps_its_stamp() -> None:
    bench = Bench()
    for number in range(5):
        bench.take(number)
    scan = bench.take(5, late_ms=250)
    assert scan is not None
    assert scan.stamp_ns / 1e6 == pytest.approx(500, abs=1.0)
    assert bench.events.counters["late_scans"] == 1


def test_stamps_in_the_future_are_stamped_by_arrival_and_counted() -> None:
    bench = Bench(stamp_offset_s=0.5)  # a clock that is half a second ahead
    found = [bench.take(number) for number in range(20)]
    stamps = [scan.stamp_ns for scan in found if scan is not None]
    assert len(stamps) == 20
    arrivals = [(PERIOD_MS * number + DELAY_MS) * 1_000_000 for number in range(20)]
    assert all(0 <= arrival - stamp <= 100_000_000 for arrival, stamp in zip(arrivals, stamps, strict=True))
    assert bench.events.counters["future_stamps"] == 20


@pytest.mark.parametrize("are_constant", [True, False])
def test_stamps_that_stand_still_or_jump_are_given_up_for_the_time_of_arrival(are_constant: bool) -> None:
    bench, rng = Bench(), np.random.default_rng(1)
    counters_ms = [1234] * 40 if are_constant else rng.integers(0, 1 << 24, 40).tolist()
    taken = [bench.take(number, bench.message(number, None, counter)) for number, counter in enumerate(counters_ms)]
    late = taken[2 * scans.USELESS_STAMPS :]
    assert all(scan is not None for scan in late)
    stamps_ns = np.array([scan.stamp_ns for scan in late if scan is not None])
    assert (np.diff(stamps_ns) == PERIOD_MS * 1_000_000).all()
    assert abs(stamps_ns[-1] - PERIOD_MS * 39 * 1_000_000) < 60_000_000
    assert bench.events.counters["useless_stamps"] == 1


def test_stamps_of_which_every_seventh_is_three_seconds_back_are_given_up_after_two_failures() -> None:
    bench, restarts, taken = Bench(), 0, []
    for number in range(200):
        back_ms = 3000 if number % 7 == 6 else 0
        taken.append(bench.take(number, bench.message(number, None, 10_000 + PERIOD_MS * number - back_ms)))
        restarts += bench.assembly.clock_restarted
        bench.assembly.clock_restarted = False
    assert restarts == scans.USELESS_STAMPS
    assert bench.events.counters["useless_stamps"] == 1
    assert all(scan is not None for scan in taken[30:])


def test_a_restart_of_the_laser_now_and_then_leaves_its_stamps_in_use() -> None:
    bench = Bench()
    for number in range(10 * scans.FORGIVING_SCANS):
        since_ms = PERIOD_MS * (number % (scans.FORGIVING_SCANS + 10))
        bench.take(number, bench.message(number, None, since_ms))
    assert bench.events.counters["clock_restarts"] == 9
    assert bench.events.counters["useless_stamps"] == 0
