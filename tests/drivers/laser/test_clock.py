import numpy as np
import pytest

from drivers.laser.clock import LaserClock
from drivers.laser.timing.counter import NS_PER_MS, CounterStatus
from drivers.scip.codec import COUNTER_MS

PERIOD_NS = 99_730_000  # no multiple of the counter's millisecond, as no motor is
DELAY_NS = 75_000_000
HOUR_NS = 3600 * 10**9


class SimulatedCounter:
    """A device clock against a host clock that is exact: the truth in these tests."""

    def __init__(self, drift_ppm: float, start_ms: int, power_on_ns: int = 0) -> None:
        self._rate = 1.0 - drift_ppm * 1e-6  # drift is how much faster the host runs
        self._start_ms = start_ms
        self._power_on_ns = power_on_ns

    def time_ms(self, host_ns: int) -> float:
        """What the device would count if its counter had fractions and no end."""
        return self._start_ms + (host_ns - self._power_on_ns) * self._rate / NS_PER_MS

    def counter_ms(self, host_ns: int) -> int:
        return int(self.time_ms(host_ns)) % COUNTER_MS

    def answers(self, host_ns: int, rng: np.random.Generator) -> list[tuple[int, int, int]]:
        """50 answers to TM1, each between 0.1 and 0.6 ms on its way."""
        found = []
        for _ in range(50):
            out_ns, back_ns = (int(delay) for delay in rng.integers(50_000, 300_000, 2))
            found.append((host_ns, host_ns + out_ns + back_ns, self.counter_ms(host_ns + out_ns)))
            host_ns += out_ns + back_ns + 100_000
        return found


def run(
    clock: LaserClock, device: SimulatedCounter, begin_ns: int, end_ns: int, rng: np.random.Generator, every: int = 1
) -> tuple[list[float], list[int]]:
    """Errors of the offset in ms after each scan between two times, and the stamps; jitter 0 to 5 ms."""
    errors, stamps = [], []
    for start_ns in range(begin_ns, end_ns, PERIOD_NS * every):
        arrival_ns = start_ns + DELAY_NS + int(rng.integers(0, 5_000_000))
        reading = clock.observe(device.counter_ms(start_ns), arrival_ns, DELAY_NS)
        if reading is not CounterStatus.STALE:
            errors.append(clock.offset_ms - (start_ns / NS_PER_MS - device.time_ms(start_ns)))
            stamps.append(clock.stamp_ns())
    return errors, stamps


@pytest.mark.parametrize("drift_ppm", [50.0])
def test_stamps_stay_within_a_millisecond_over_two_wraps_and_a_restart(drift_ppm: float) -> None:
    rng = np.random.default_rng(7)
    clock = LaserClock(200.0)
    device = SimulatedCounter(drift_ppm, COUNTER_MS - 60_000)
    assert clock.synchronise(device.answers(0, rng), DELAY_NS) is CounterStatus.GOOD
    end_ns = round(4.7 * HOUR_NS)  # one wrap after a minute, one after 4.66 h
    minutes_ns = 600 * 10**9
    errors, stamps = run(clock, device, 50_000_000, minutes_ns, rng)
    for begin_ns, stop_ns, every in ((minutes_ns, end_ns - minutes_ns, 20), (end_ns - minutes_ns, end_ns, 1)):
        further_errors, further_stamps = run(clock, device, begin_ns, stop_ns, rng, every)
        errors, stamps = errors + further_errors, stamps + further_stamps
    assert clock.wraps == 2
    assert clock.drift_ppm == pytest.approx(drift_ppm, abs=2.0)

    device = SimulatedCounter(drift_ppm, 0, end_ns + 10**9)
    assert clock.synchronise(device.answers(end_ns + 3 * 10**9, rng), DELAY_NS) is CounterStatus.RESTARTED
    more_errors, more_stamps = run(clock, device, end_ns + 3_100_000_000, end_ns + 300 * 10**9, rng)

    assert max(map(abs, errors + more_errors)) < 1.0
    assert np.all(np.diff(stamps + more_stamps) > 0)
    assert clock.wraps == 2


def test_the_offset_is_within_a_millisecond_from_the_first_scan_on_whatever_the_jitter_was() -> None:
    errors, uncertainties = [], []
    for seed in range(80):
        rng = np.random.default_rng(seed)
        clock = LaserClock(200.0)
        device = SimulatedCounter((50.0, -50.0)[seed % 2], COUNTER_MS - 20_000)
        clock.synchronise(device.answers(0, rng), DELAY_NS)
        for begin_ns in range(50_000_000, 45 * 10**9, 10**9):
            errors.append(max(map(abs, run(clock, device, begin_ns, begin_ns + 10**9, rng)[0])))
            uncertainties.append(clock.offset_uncertainty_ms)
    assert max(errors) < 1.0
    assert np.mean(np.array(errors) < np.array(uncertainties)) > 0.95


def test_a_start_under_load_costs_a_millisecond_and_not_three() -> None:
    for seed in range(8):
        rng = np.random.default_rng(seed)
        clock, device = LaserClock(200.0), SimulatedCounter(50.0, 0)
        clock.synchronise(device.answers(0, rng), DELAY_NS)
        errors = []
        for start_ns in range(50_000_000, 60 * 10**9, PERIOD_NS):
            held_ns = int(rng.integers(0, 20_000_000 if start_ns < 3 * 10**9 else 5_000_000))
            clock.observe(device.counter_ms(start_ns), start_ns + DELAY_NS + held_ns, DELAY_NS)
            errors.append(clock.offset_ms - (start_ns / NS_PER_MS - device.time_ms(start_ns)))
        assert max(map(abs, errors)) < 2.0


def test_a_wrap_is_no_restart_and_a_restart_is_no_wrap() -> None:
    clock = LaserClock(200.0)
    readings = [
        clock.observe(counter_ms, arrival_ms * NS_PER_MS, DELAY_NS)
        for counter_ms, arrival_ms in [(COUNTER_MS - 150, 1000), (COUNTER_MS - 50, 1100), (50, 1200), (150, 1300)]
    ]
    assert readings == [CounterStatus.GOOD] * 4
    assert clock.wraps == 1
    assert clock.observe(0, 1400 * NS_PER_MS, DELAY_NS) is CounterStatus.RESTARTED
    assert clock.wraps == 1


def test_a_wrap_during_hours_of_silence_is_counted() -> None:
    clock = LaserClock(200.0)
    clock.observe(1000, 0, DELAY_NS)
    silence_ns = 6 * HOUR_NS
    counter_ms = (1000 + silence_ns // NS_PER_MS) % COUNTER_MS
    assert clock.observe(counter_ms, silence_ns, DELAY_NS) is CounterStatus.GOOD
    assert clock.wraps == 1


def test_a_restart_in_the_stream_is_told_even_soon_after_power_on() -> None:
    clock = LaserClock(200.0)
    clock.observe(300, 0, DELAY_NS)
    clock.observe(400, PERIOD_NS, DELAY_NS)
    assert clock.observe(0, 2 * PERIOD_NS, DELAY_NS) is CounterStatus.RESTARTED


def test_a_stamp_that_stands_still_is_told() -> None:
    clock = LaserClock(200.0)
    clock.observe(300, 0, DELAY_NS)
    assert clock.observe(300, PERIOD_NS, DELAY_NS) is CounterStatus.STALE
    assert clock.observe(500, 2 * PERIOD_NS, DELAY_NS) is CounterStatus.GOOD


def test_a_scan_that_began_before_the_clock_was_asked_is_no_restart() -> None:
    clock = LaserClock(200.0)
    clock.synchronise([(1_000_000_000, 1_000_200_000, 5000)], DELAY_NS)
    assert clock.observe(4970, 1_045_000_000, DELAY_NS) is CounterStatus.GOOD
    assert clock.stamp_ns() == pytest.approx(970_000_000, abs=2_000_000)


def test_without_answers_the_nominal_delay_counts() -> None:
    rng = np.random.default_rng(3)
    clock = LaserClock(200.0)
    clock.synchronise([], DELAY_NS)
    errors, _ = run(clock, SimulatedCounter(50.0, 0), 0, 120 * 10**9, rng)
    assert max(map(abs, errors[50:])) < 2.5
    assert clock.offset_uncertainty_ms > 30.0


@pytest.mark.parametrize("step_ns", [300_000_000, -40_000_000])
def test_a_link_that_changes_its_delay_for_good_does_not_move_the_stamps(step_ns: int) -> None:
    rng = np.random.default_rng(5)
    clock, device = LaserClock(200.0), SimulatedCounter(20.0, 0)
    clock.synchronise(device.answers(0, rng), DELAY_NS)
    run(clock, device, 50_000_000, 200 * 10**9, rng)
    errors = []
    for start_ns in range(200 * 10**9, 900 * 10**9, PERIOD_NS):
        arrival_ns = start_ns + DELAY_NS + step_ns + int(rng.integers(0, 5_000_000))
        clock.observe(device.counter_ms(start_ns), arrival_ns, DELAY_NS)
        errors.append((clock.stamp_ns() - start_ns) / NS_PER_MS)
    assert max(map(abs, errors)) < 4.0
    assert clock.lateness_ns(arrival_ns) < 6_000_000


def test_a_message_held_back_once_is_late_and_moves_nothing() -> None:
    rng = np.random.default_rng(5)
    clock, device = LaserClock(200.0), SimulatedCounter(20.0, 0)
    clock.synchronise(device.answers(0, rng), DELAY_NS)
    run(clock, device, 50_000_000, 60 * 10**9, rng)
    start_ns = 60 * 10**9
    arrival_ns = start_ns + DELAY_NS + 400_000_000
    clock.observe(device.counter_ms(start_ns), arrival_ns, DELAY_NS)
    assert clock.lateness_ns(arrival_ns) == pytest.approx(400_000_000, abs=2_000_000)
    assert clock.stamp_ns() == pytest.approx(start_ns, abs=1_000_000)


def test_the_uncertainty_covers_the_error() -> None:
    rng = np.random.default_rng(11)
    clock, device = LaserClock(200.0), SimulatedCounter(50.0, 0)
    clock.synchronise(device.answers(0, rng), DELAY_NS)
    errors, _ = run(clock, device, 50_000_000, 300 * 10**9, rng)
    assert abs(clock.drift_ppm - 50.0) < 4.0 * clock.drift_uncertainty_ppm
    assert abs(float(np.mean(errors[-100:]))) < clock.offset_uncertainty_ms + 0.5


def test_a_restart_between_the_answers_and_the_first_scan_is_told_once() -> None:
    clock = LaserClock(200.0)
    clock.synchronise([(10**9, 1_000_200_000, 5000)], DELAY_NS)
    clock.observe(5000, 1_075_000_000, DELAY_NS)
    clock.synchronise([(2 * 10**9, 2_000_200_000, 300)], DELAY_NS)  # restarted, and again before its next scan
    assert clock.observe(50, 2_125_000_000, DELAY_NS) is CounterStatus.RESTARTED
    clock.synchronise([(2_150_000_000, 2_150_200_000, 150)], DELAY_NS)
    assert clock.observe(200, 2_275_000_000, DELAY_NS) is CounterStatus.GOOD
    assert clock.stamp_ns() == pytest.approx(2_200_000_000, abs=2_000_000)


@pytest.mark.parametrize("late_ns", [200_000_000, 700_000_000])
def test_a_first_scan_that_a_busy_host_held_up_is_no_restart_and_another_clock_is(late_ns: int) -> None:
    rng = np.random.default_rng(5)
    clock, device = LaserClock(200.0), SimulatedCounter(0.0, 0)
    clock.synchronise(device.answers(0, rng), DELAY_NS)
    run(clock, device, 50_000_000, 10 * 10**9, rng)
    clock.synchronise(device.answers(10 * 10**9, rng), DELAY_NS)

    def read(start_ns: int, held_up_ns: int) -> CounterStatus:
        return clock.observe(device.counter_ms(start_ns), start_ns + DELAY_NS + held_up_ns, DELAY_NS)

    assert read(10_100_000_000, late_ns) is CounterStatus.GOOD
    assert clock.stamp_ns() == pytest.approx(10_100_000_000, abs=2_000_000)
    assert read(10_200_000_000, 0) is CounterStatus.GOOD
    assert clock.misfits == 0
    clock.synchronise(device.answers(11 * 10**9, rng), DELAY_NS)
    late = [read(11_100_000_000 + beat * PERIOD_NS, late_ns) for beat in range(4)]
    assert late == [CounterStatus.GOOD, CounterStatus.GOOD, CounterStatus.RESTARTED, CounterStatus.GOOD]
    assert clock.misfits == 1


def test_microseconds_take_away_the_half_millisecond_of_a_counter() -> None:
    rng = np.random.default_rng(3)
    clock, device = LaserClock(200.0), SimulatedCounter(20.0, 0)

    def told(host_ns: int) -> tuple[int, int]:
        whole_us = int(device.time_ms(host_ns) * 1000)
        return whole_us // 1000 % COUNTER_MS, whole_us % 1000

    clock.synchronise([(ns, ns + 200_000, *told(ns + 100_000)) for ns in range(0, 10_000_000, 1_000_000)], DELAY_NS)
    errors = []
    for start_ns in range(50_000_000, 20 * 10**9, PERIOD_NS):
        counter_ms, fraction_us = told(start_ns)
        arrival_ns = start_ns + DELAY_NS + int(rng.integers(0, 300_000))
        clock.observe(counter_ms, arrival_ns, DELAY_NS, fraction_us)
        errors.append(abs(clock.stamp_ns() - start_ns))
    assert max(errors) < 300_000
    assert clock.offset_uncertainty_ms < 1.0
