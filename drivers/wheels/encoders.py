"""The wheel encoders on a CAN bus: one supervised reader thread around pure parts."""

import errno
import threading
from collections import deque
from collections.abc import Callable

from drivers.canbus.advice import bitrate_advice, bus_off_advice
from drivers.canbus.arrival_clock import ArrivalClock
from drivers.canbus.bus import BusReadError, CanBus, NotAFrameError
from drivers.canbus.error_frames import BusCondition, ErrorFrames
from drivers.canbus.frame import ERROR, CanFrame
from drivers.events import EventLog
from drivers.measurements import (
    Event,
    LinkError,
    RawTap,
    SensorHealth,
    SensorState,
    Severity,
    WheelCounts,
)
from drivers.settings.encoders import EncoderSettings
from drivers.stoppable_thread import StoppableThread
from drivers.wheels.layouts.choose import wheel_decoder
from drivers.wheels.pair import WheelPair
from drivers.wheels.state import CHECK_POWER

SILENCE_S = 0.5  # seconds without any frame after which the bus is opened again
BACKOFF_MIN_S = 0.1  # seconds before the first new attempt to open
BACKOFF_MAX_S = 0.5  # longest wait between attempts; a bus that is back must be used within 1 s
WAIT_S = 0.1  # how often a reader without frames looks up: ages are judged and close() is heard
ERRORS_BEFORE_REOPENING = 3  # one broken line of slcan is no reason, a poisoned buffer is
STRANGERS = 100  # things in a row that are no frame before they are waited for
STRANGER_WAIT_S = 0.01
FLOOD_FRAMES, FLOOD_WAIT_S = 50, 0.025  # of a bus that the kernel throws away from: who always reads starves the loop
ERRORS_WITHOUT_GOOD = 50  # error frames in a row after which the bit rate is doubted
OVERFLOW = (
    "frames were lost because the kernel's buffer was full; raise encoders.bus.receive_buffer_bytes and "
    "sudo sysctl net.core.rmem_max, relieve the processor, or find who floods the bus"
)
UNSIGNED = (
    "{0} wheel: its speed has no sign and no direction signal is configured, so driving backwards counts "
    "as forwards; name the signal in encoders.layout.{0}.direction"
)
LATE = "frames waited before they were read; the counts are right, but the processor is overloaded"
CLOCK_JUMP = "the system clock has jumped; ages and stamps use the monotonic clock and stay right"
RATE_WINDOW_NS = 2_000_000_000
LATE_NS = 150_000_000  # a frame that was read so long after its arrival tells of a reader that was held up
OVERFLOW_CHECK_NS = 200_000_000  # how often the kernel is asked what it threw away


class CanEncoders:
    """Implements Encoders. The thread owns the bus; everything else is under one lock that is never held while waiting.

    Raises DriverError at once where the layout cannot be used: that is configuration, and waiting does not mend it.
    """

    def __init__(
        self,
        settings: EncoderSettings,
        now_ns: Callable[[], int],
        tap: RawTap | None = None,
        alive: Callable[[], None] = lambda: None,
    ) -> None:
        """alive: called by the thread in each turn of its loop, at least every few seconds."""
        self._settings = settings
        self._now_ns = now_ns
        self._tap = tap
        self._events = EventLog("encoders")
        self._frames = wheel_decoder(settings)
        self._pair = WheelPair(settings, self._frames, self._events)
        self._errors = ErrorFrames()
        self._lock = threading.Lock()
        self._thread = StoppableThread("encoders", self._run, alive, self._note_defect)
        self._link_trouble: str | None = None  # until the bus was tried
        self._handed_out: deque[int] = deque(maxlen=256)

    def start(self) -> None:
        """Begin reading; the bus may come later."""
        self._thread.start()

    def drain(self) -> tuple[WheelCounts, ...]:
        """All samples since the last call, oldest first; judges silence even where the thread is held up."""
        with self._lock:
            self._pair.check(self._now_ns())
            samples = self._pair.take()
            self._handed_out.extend(sample.stamp_ns for sample in samples if sample.valid)
        return samples

    def drain_events(self) -> tuple[Event, ...]:
        """Events since the last call."""
        with self._lock:
            return self._events.drain()

    def health(self) -> SensorHealth:
        """State now, every counter by reason, and the bus as the controller sees it."""
        with self._lock:
            now_ns = self._now_ns()
            state, reason = self._state(now_ns)
            counters = {f"bus.{name}": count for name, count in self._events.counters.items() if count}
            ages = {}
            for wheel in (self._pair.left, self._pair.right):
                counters |= {f"{wheel.wheel}.{name}": count for name, count in wheel.counters.items() if count}
                age_ns = wheel.age_ns(now_ns)
                if age_ns is not None:
                    ages[f"{wheel.wheel}_age_s"] = age_ns * 1e-9
            recent = sum(1 for stamp_ns in self._handed_out if now_ns - stamp_ns < RATE_WINDOW_NS)
            facts = {
                "bus": f"{self._settings.bus.interface} {self._settings.bus.channel}",
                "condition": str(self._errors.condition),
            } | ({"advice": "; ".join(map(UNSIGNED.format, self._frames.unsigned))} if self._frames.unsigned else {})
            return SensorHealth(state, reason, recent / (RATE_WINDOW_NS * 1e-9), counters, ages, facts)

    def close(self) -> None:
        """Stop the thread, which leaves the bus; returns within 2 s whatever the bus does."""
        self._thread.stop()

    def _state(self, now_ns: int) -> tuple[SensorState, str]:
        """FAILED: odometry is not to be used; STALE: degraded; STARTING: never heard so far."""
        pair, bus = self._pair, self._settings.bus
        if self._link_trouble is None:
            return SensorState.STARTING, f"opening {bus.interface} {bus.channel}"
        if self._link_trouble:
            return SensorState.FAILED, self._link_trouble
        if self._errors.condition is BusCondition.OFF:
            return SensorState.FAILED, bus_off_advice(bus)
        if self._errors.since_good >= ERRORS_WITHOUT_GOOD:
            return SensorState.FAILED, bitrate_advice(bus)
        trouble = pair.trouble(now_ns)
        if trouble:
            return SensorState.FAILED, trouble
        unheard = {
            str(wheel.wheel): wheel.refusal(now_ns) or f"not heard so far; {CHECK_POWER}"
            for wheel in (pair.left, pair.right)
            if wheel.age_ns(now_ns) is None
        }
        if unheard:
            who = f"{next(iter(unheard))} wheel" if len(unheard) == 1 else "both wheels"
            return SensorState.STARTING, f"{who}: {next(iter(unheard.values()))}"
        for wheel in (pair.left, pair.right):
            age_ns = wheel.age_ns(now_ns)
            assert age_ns is not None
            if age_ns > self._settings.degraded_ns:
                return SensorState.STALE, f"{wheel.wheel} wheel: late by {age_ns * 1e-6:.0f} ms"
            if wheel.stuck:
                return (
                    SensorState.STALE,
                    f"{wheel.wheel} wheel: no count while the other wheel rolls; check its encoder",
                )
        if self._errors.condition is not BusCondition.ACTIVE:
            return (
                SensorState.STALE,
                f"CAN controller is {self._errors.condition}; check cable and termination",
            )
        return SensorState.FRESH, "both wheels are heard"

    def _run(self) -> None:
        """Open, read until the bus fails, open again with back-off; for as long as the rover runs."""
        bus_settings = self._settings.bus
        wait_s, silence_s = BACKOFF_MIN_S, SILENCE_S
        clock = ArrivalClock()
        for wheel in self._frames.unsigned:
            self._report("unsigned", 1, UNSIGNED.format(wheel))
        while not self._thread.is_stopping():
            try:
                bus = CanBus(bus_settings, self._frames.ids, self._now_ns, clock)
            except LinkError as error:
                self._note_link("open", str(error))
                self._thread.wait(wait_s)
                wait_s = min(2.0 * wait_s, BACKOFF_MAX_S)
                continue
            with self._lock:
                self._events.count("sessions")
                self._link_trouble = ""
                self._errors.reopened()
            try:
                heard = self._read(bus, silence_s)
            finally:
                bus.close()
            wait_s = BACKOFF_MIN_S if heard else min(2.0 * wait_s, BACKOFF_MAX_S)
            # an idle bus is not opened again twice a second for ever
            silence_s = SILENCE_S if heard else min(2.0 * silence_s, 8.0 * SILENCE_S)
            self._thread.wait(wait_s)

    def _read(self, bus: CanBus, silence_s: float) -> bool:
        """Feed frames until the bus is to be opened anew; returns whether any frame was heard."""
        heard, errors, strangers, jumps = False, 0, 0, bus.clock_jumps
        last_ns = checked_ns = self._now_ns()
        overflowed, is_flooded, turns = 0, False, 0
        self._wake_up(bus)
        while not self._thread.is_stopping():
            try:
                frame = bus.receive(WAIT_S)
            except NotAFrameError as error:
                strangers += 1
                self._note_link("not_a_frame", str(error), keep=True, key="not_a_frame")
                if strangers > STRANGERS:  # an adapter whose buffer is spoilt, or a flood
                    self._thread.wait(STRANGER_WAIT_S)
                frame = None  # beside which the wheels are silent
            except BusReadError as error:
                errors += 1
                self._note_link("read", str(error))
                if error.number != errno.ENETDOWN and (error.number is not None or errors >= ERRORS_BEFORE_REOPENING):
                    return heard
                self._thread.wait(WAIT_S)  # the same socket works again when the interface is up
                continue
            now_ns = self._now_ns()
            if now_ns - checked_ns > OVERFLOW_CHECK_NS:
                checked_ns, before, overflowed = now_ns, overflowed, bus.overflowed
                if is_flooded := overflowed > before:
                    self._report("overflow", overflowed - before, OVERFLOW)
            turns += 1
            if is_flooded and turns % FLOOD_FRAMES == 0:
                self._thread.wait(FLOOD_WAIT_S)
            if frame is None:
                with self._lock:
                    self._pair.check(now_ns)
                if now_ns - last_ns > silence_s * 1e9:
                    self._note_link("silent", self._silence())
                    return heard
                continue
            heard, errors, strangers, last_ns = True, 0, 0, now_ns
            self._handle_frame(bus, frame)
            if now_ns - frame.stamp_ns > LATE_NS:
                self._report("late", 1, LATE)
            if bus.clock_jumps != jumps:
                jumps = bus.clock_jumps
                self._report("clock_jump", 1, CLOCK_JUMP, Severity.INFO)
        return heard

    def _report(self, kind: str, count: int, text: str, severity: Severity = Severity.WARN) -> None:
        """Count and tell what is no failure of the link."""
        with self._lock:
            self._events.add(self._now_ns(), kind, text, severity, amount=count)

    def _handle_frame(self, bus: CanBus, frame: CanFrame) -> None:
        """One frame: recorded first, then judged."""
        if self._tap is not None:
            self._tap.can_frame(*frame[:2], frame.flags, frame.data)
        with self._lock:
            self._link_trouble = ""
            if frame.flags & ERROR:
                self._handle_error_frame(frame)
                return
            good = self._pair.good_frames
            self._pair.feed(frame)
            if self._pair.good_frames != good:
                self._errors.good_frame()
            wanted = self._pair.left.wake_up_wanted or self._pair.right.wake_up_wanted
            self._pair.left.wake_up_wanted = self._pair.right.wake_up_wanted = False
        if wanted:
            self._wake_up(bus)

    def _handle_error_frame(self, frame: CanFrame) -> None:
        before = self._errors.condition
        names = self._errors.error(frame.arbitration_id, frame.data)
        for name in names:
            self._events.count(name)
        if self._errors.condition is BusCondition.OFF:
            self._events.add(frame.stamp_ns, "bus_off", bus_off_advice(self._settings.bus), Severity.ERROR, amount=0)
        elif self._errors.since_good == ERRORS_WITHOUT_GOOD:
            self._events.add(frame.stamp_ns, "bitrate", bitrate_advice(self._settings.bus), Severity.ERROR, amount=0)
        elif self._errors.condition is not before or "restarted" in names:
            text = f"CAN controller says {', '.join(names)}; it is now {self._errors.condition}"
            self._events.add(frame.stamp_ns, names[0], text, amount=0)

    def _wake_up(self, bus: CanBus) -> None:
        """Tell CANopen nodes to start sending."""
        for frame in self._frames.wake_up:
            try:
                bus.send(frame)
            except BusReadError as error:
                self._note_link("send", str(error), keep=True)

    def _silence(self) -> str:
        if self._errors.since_good:
            return bitrate_advice(self._settings.bus)
        bus = self._settings.bus
        return f"CAN bus {bus.interface} {bus.channel}: no frame at all; check that the nodes have power"

    def _note_defect(self, what: str) -> None:
        """Tell what was raised in the thread, which begins anew."""
        text = f"defect in the encoders' driver, restarting: {what}"
        with self._lock:
            self._events.add(self._now_ns(), "defects", text, Severity.ERROR)
            self._link_trouble = text

    def _note_link(self, kind: str, text: str, keep: bool = False, key: str = "") -> None:
        """Count and tell trouble of the bus. keep: the link is not failed by it. key: what is limited in rate."""
        with self._lock:
            self._events.add(self._now_ns(), kind, text, key=key or f"{kind} {text}")
            if not keep:
                self._link_trouble = text
