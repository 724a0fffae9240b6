"""Two simulated encoder nodes as pure state: time and true travel in, CAN frames out.

Messages are those of infant.dbc, whose layout is the only one that these nodes speak.
"""

from functools import partial

import numpy as np
from cantools.database.can import Message

from drivers.canbus.frame import CanFrame
from drivers.settings.layouts import DbcLayout
from drivers.settings.simulated_wheels import SimulatedWheelSettings, WheelFault
from drivers.simulated.wheels.faults import ActiveFault, error_frame, restarted_frame, with_fault
from drivers.simulated.wheels.odometer import WheelOdometer
from drivers.wheels.layouts.messages import FeedbackMessage, InfoMessage
from drivers.wheels.readings import NodeInfo, Wheel

LAYOUT = DbcLayout()
COUNT_MASK = 0xFFFFFFFF
ERROR_FRAMES_PER_BEAT = 5
SCHEMA_VERSION = 1
TOP_SPEED = 2046  # count/period: the ends of 12 signed bits say that there is no speed


class EncoderNode:
    """One node: counts, and says so in the rover's own layout."""

    def __init__(
        self,
        wheel: Wheel,
        settings: SimulatedWheelSettings,
        messages: dict[str, Message],
        odometer: WheelOdometer,
        start_ns: int,
        offset: int = 0,
    ) -> None:
        self._signals = LAYOUT.left if wheel is Wheel.LEFT else LAYOUT.right
        assert self._signals.info is not None
        self._feedback = FeedbackMessage(wheel, messages[self._signals.message], self._signals, 1.0)
        self._info = InfoMessage(wheel, messages[self._signals.info.message], self._signals.info)
        self._settings = settings
        self._odometer = odometer
        self._offset = settings.start_count + offset
        self._sent: int | None = None
        self._booted_ns = start_ns
        self.wheel = wheel
        self.boot_id = settings.start_boot_id
        self.alive = 0
        self.true_count = 0

    def feedback(self, stamp_ns: int, travel_m: float, faults: set[str], jump: int, status: int) -> CanFrame:
        """The frame of this beat. faults: names of those that change what the node says."""
        self.true_count = self._odometer.count(travel_m)
        speed = self.true_count - (self.true_count if self._sent is None else self._sent)
        self._sent = self.true_count
        if "stuck" in faults:
            # the register stands still, so the pulses of this beat are lost for good
            self._offset -= speed
        count = self.true_count + self._offset + jump
        frame = self._feedback.encode(
            {
                self._signals.count: count & COUNT_MASK,
                self._signals.speed: max(-TOP_SPEED, min(TOP_SPEED, speed)),
                self._signals.status: status,
                self._signals.alive: self.alive,
                self._signals.boot_id: self.boot_id,
            },
            stamp_ns,
        )
        if "alive_frozen" not in faults:
            self.alive = (self.alive + 1) % 16
        return frame

    def info(self, stamp_ns: int, counts_per_rev: int) -> CanFrame:
        """What the node says of itself."""
        uptime_ms = (stamp_ns - self._booted_ns) // 1_000_000
        said = NodeInfo(self.wheel, counts_per_rev, round(self._settings.period_ms), SCHEMA_VERSION, uptime_ms)
        return self._info.encode(said, stamp_ns)

    def reboot(self, stamp_ns: int, travel_m: float) -> None:
        """Power comes back: the count begins at 0, the boot id is the next."""
        self._offset = -self._odometer.count(travel_m)
        self._sent = None
        self._booted_ns = stamp_ns
        self.boot_id = (self.boot_id + 1) % 16
        self.alive = 0


class EncoderNodes:
    """Both nodes and the faults that are on. Frames carry the moment of sending as their stamp."""

    def __init__(
        self,
        settings: SimulatedWheelSettings,
        messages: dict[str, Message],
        start_ns: int,
        rng: np.random.Generator,
    ) -> None:
        self._settings = settings
        self._messages = messages
        self._rng = rng
        self._nodes = {
            wheel: EncoderNode(wheel, settings, messages, WheelOdometer(settings, factor, rng), start_ns)
            for wheel, factor in (
                (Wheel.LEFT, settings.left_radius_factor),
                (Wheel.RIGHT, settings.right_radius_factor),
            )
        }
        self._doubles: dict[Wheel, EncoderNode] = {}
        self._start_ns = start_ns
        self._active = [ActiveFault(fault, start_ns) for fault in settings.faults]
        self._travel_m = dict.fromkeys(Wheel, 0.0)

    def inject(self, fault: WheelFault, now_ns: int) -> None:
        """Begin a fault."""
        self._active.append(ActiveFault(fault, now_ns))

    def clear(self, now_ns: int) -> list[CanFrame]:
        """End all faults; returns the error frames that a controller reports on that."""
        ended, self._active = self._active, []
        return self._end(ended, now_ns)

    def beat(self, wheel: Wheel, stamp_ns: int, travel_m: float) -> list[CanFrame]:
        """All frames that one node's beat puts on the bus. travel_m: true distance rolled since the start."""
        self._travel_m[wheel] = travel_m
        over = [active for active in self._active if active.is_over(stamp_ns)]
        self._active = [active for active in self._active if not active.is_over(stamp_ns)]
        extra = self._end(over, stamp_ns)
        own = [active for active in self._active if active.affects(wheel)]
        names = {active.fault.name for active in own}
        node = self._nodes[wheel]
        status = next((active.fault.value for active in own if active.fault.name == "status"), 0)
        jump = round(sum(active.fault.magnitude for active in own if active.fault.name == "jump"))
        frames = [node.feedback(stamp_ns, travel_m, set(names), jump, status)]
        if "power_cycle" in names:
            return extra
        for active in own:
            double = partial(self._double, wheel, stamp_ns, travel_m, active)
            frames = with_fault(frames, active, self._rng, double)
        for active in self._active:
            error = error_frame(active.fault.name, stamp_ns)
            if error is not None:
                frames = [error] * (ERROR_FRAMES_PER_BEAT if active.fault.name == "error_flood" else 1)
        return extra + frames

    def info(self, wheel: Wheel, stamp_ns: int) -> list[CanFrame]:
        """The slow message, unless the node is off or cut off."""
        counts_per_rev = self._settings.counts_per_rev
        for active in self._active:
            if not active.affects(wheel):
                continue
            if active.fault.name in ("power_cycle", "silence", "silence_all", "bus_off", "error_flood"):
                return []
            if active.fault.name == "wrong_counts_per_rev":
                counts_per_rev = active.fault.value
        return [self._nodes[wheel].info(stamp_ns, counts_per_rev)]

    def true_count(self, wheel: Wheel) -> int:
        """Unwrapped count of this wheel since the start, free of faults: the truth for tests."""
        return self._nodes[wheel].true_count

    def _end(self, ended: list[ActiveFault], now_ns: int) -> list[CanFrame]:
        frames = []
        for active in ended:
            if active.fault.name == "bus_off":
                frames.append(restarted_frame(now_ns))
            for wheel, node in self._nodes.items():
                if active.fault.name == "power_cycle" and active.affects(wheel):
                    node.reboot(now_ns, self._travel_m[wheel])
        return frames

    def _double(self, wheel: Wheel, stamp_ns: int, travel_m: float, active: ActiveFault) -> CanFrame:
        """A frame of the other node under the same id: it counts a wheel of its own."""
        if wheel not in self._doubles:
            odometer = WheelOdometer(self._settings, 1.0, self._rng)
            offset = round(active.fault.magnitude)
            double = EncoderNode(wheel, self._settings, self._messages, odometer, stamp_ns, offset)
            double.boot_id, double.alive = active.fault.value % 16, 7
            self._doubles[wheel] = double
        return self._doubles[wheel].feedback(stamp_ns + 1_000_000, 0.6 * travel_m, set(), 0, 0)
