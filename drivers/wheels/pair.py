"""Frames of both wheels to samples at common instants; pure: time comes with the frames.

Never the latest left with the latest right: at 1.94 m/s a skew of 20 ms looks like 39 mm between the wheels.
"""

from collections import deque

from drivers.canbus.frame import CanFrame
from drivers.events import EventLog
from drivers.measurements import WheelCounts
from drivers.settings.encoders import EncoderSettings
from drivers.wheels.readings import Gear, NodeAlarm, NodeInfo, NodeState, Refused, Wheel, WheelDecoder, WheelReading
from drivers.wheels.state import WheelState

INVALID_EVERY_NS = 100_000_000


class WheelPair:
    """Fold frames with `feed`, let time pass with `check`, fetch samples with `take`."""

    def __init__(self, settings: EncoderSettings, frames: WheelDecoder, events: EventLog | None = None) -> None:
        self.events = events if events is not None else EventLog("encoders")
        self.left = WheelState(Wheel.LEFT, settings, settings.left, frames, self.events)
        self.right = WheelState(Wheel.RIGHT, settings, settings.right, frames, self.events)
        self.good_frames = 0
        self._frames = frames
        self._apart_ns = settings.period_ns // 2
        self._together_ns = 2 * settings.period_ns
        self._wheels = {Wheel.LEFT: self.left, Wheel.RIGHT: self.right}
        self._samples: deque[WheelCounts] = deque()
        self._last: WheelCounts | None = None
        self._offsets = (0.0, 0.0)
        self._epochs: tuple[int, int] | None = None
        self._valid_epochs: tuple[int, int] | None = None

    def feed(self, frame: CanFrame) -> None:
        """Take one frame of any id, in the order of arrival."""
        for item in self._frames.decode(frame):
            wheel = self._wheels[item.wheel]
            match item:
                case WheelReading():
                    self._read(wheel, frame.stamp_ns, wheel.directed(frame.stamp_ns, item))
                case Gear():
                    wheel.shift(frame.stamp_ns, item.direction)
                case Refused():
                    wheel.counters[item.reason] += 1
                    wheel.bad_frames.add()
                    wheel.refuse(frame.stamp_ns, item.reason)
                case NodeInfo():
                    wheel.inform(frame.stamp_ns, item)
                case NodeState():
                    wheel.node_state(frame.stamp_ns, item.state)
                case NodeAlarm():
                    wheel.node_alarm(frame.stamp_ns, item.code)
        self.check(frame.stamp_ns)

    def check(self, now_ns: int) -> None:
        """Say that nothing is known where that is so, ten times a second."""
        last = self._last
        if last is None or now_ns - last.stamp_ns < INVALID_EVERY_NS:
            return
        faults = [(wheel, reason) for wheel in (self.left, self.right) if (reason := wheel.fault(now_ns))]
        for wheel, reason in faults:
            wheel.note(now_ns, "invalid", reason)
        if faults:
            self._emit(now_ns, last.left, last.right, False)

    def take(self) -> tuple[WheelCounts, ...]:
        """Samples since the last call, oldest first, stamps strictly increasing."""
        samples = []
        while self._samples:
            samples.append(self._samples.popleft())
        return tuple(samples)

    def trouble(self, now_ns: int) -> str:
        """The fault of a wheel, or of both the first's, named; empty where both are good."""
        faults = [(wheel.wheel, reason) for wheel in (self.left, self.right) if (reason := wheel.fault(now_ns))]
        if not faults:
            return ""
        (wheel, reason), *others = faults
        return f"both wheels: {reason}" if others else f"{wheel} wheel: {reason}"

    def _read(self, wheel: WheelState, stamp_ns: int, reading: WheelReading) -> None:
        counter = wheel.counter
        epoch, lost = counter.epoch, counter.counters["lost"]
        reason = counter.update(stamp_ns, reading)
        if reason is not None:
            wheel.refuse(stamp_ns, reason)
            if reason != "two_senders":
                return
        wheel.bad_frames.drain()
        self.good_frames += 1
        if counter.epoch != epoch:
            wheel.note(stamp_ns, "gap", "restarts; motion since its last good frame is unknown")
        if counter.counters["lost"] > lost:
            self._compare_losses(wheel, stamp_ns)
        for point in counter.points:
            wheel.history.add(*point)
        counter.points.clear()
        self._sample(stamp_ns)

    def _compare_losses(self, wheel: WheelState, stamp_ns: int) -> None:
        """Frames of both wheels missing at once are no fault of a node: a receive buffer has run over."""
        other = self.right if wheel is self.left else self.left
        wheel.lost_at_ns = stamp_ns
        if other.lost_at_ns is not None and stamp_ns - other.lost_at_ns < self._together_ns:
            text = (
                "frames of both wheels are missing at the same time; the reader was held up or the bus was interrupted"
            )
            self.events.add(stamp_ns, "lost_together", text)

    def _sample(self, now_ns: int) -> None:
        """A sample at the newest instant that both wheels have passed, if it is a new one."""
        left, right = self.left.history, self.right.history
        if left.newest_ns is None or right.newest_ns is None:
            return
        instant_ns = min(left.newest_ns, right.newest_ns)
        if self._last is not None and instant_ns < self._last.stamp_ns + self._apart_ns:
            return  # one sample per period: the second wheel's frame of the same beat adds nothing
        if self.left.fault(now_ns) or self.right.fault(now_ns):
            return
        at_left, at_right = left.at(instant_ns), right.at(instant_ns)
        if at_left is None or at_right is None:
            return
        epochs = (at_left[1], at_right[1])
        if epochs != self._epochs:
            # motion of one wheel since the last sample is unknown, so that of the other is not used either:
            # alone it would turn the rover
            first, self._epochs = self._last is None, epochs
            held = (0.0, 0.0) if self._last is None else (self._last.left, self._last.right)
            self._offsets = (held[0] - at_left[0], held[1] - at_right[0])
            self._emit(instant_ns, *held, first)
            self._valid_epochs = epochs if first else self._valid_epochs
            return
        unbroken = self._last is not None and not self._last.valid and self._valid_epochs == epochs
        self._emit(instant_ns, at_left[0] + self._offsets[0], at_right[0] + self._offsets[1], True, unbroken)
        self._valid_epochs = epochs
        self.left.compare_travel(at_left[0], at_right[0], instant_ns)
        self.right.compare_travel(at_right[0], at_left[0], instant_ns)

    def _emit(self, stamp_ns: int, left: float, right: float, valid: bool, unbroken: bool = False) -> None:
        self._last = WheelCounts(stamp_ns, left, right, valid, unbroken)
        self._samples.append(self._last)
