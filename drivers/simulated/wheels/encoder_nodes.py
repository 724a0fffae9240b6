"""Both simulated encoder nodes as pure state, and the faults that are on: time and true travel in, CAN frames out."""

from functools import partial

import numpy as np

from drivers.canbus.frame import CanFrame
from drivers.settings.encoders import EncoderSettings
from drivers.settings.simulated_wheels import SimulatedWheelSettings, WheelFault
from drivers.simulated.wheels.encoder_node import EncoderNode
from drivers.simulated.wheels.faults import ActiveFault, error_frame, restarted_frame, with_fault
from drivers.simulated.wheels.odometer import WheelOdometer
from drivers.simulated.wheels.spoken_layout import spoken_layout
from drivers.wheels.readings import Wheel

ERROR_FRAMES_PER_BEAT = 5


class EncoderNodes:
    """Both nodes and the faults that are on. Frames carry the moment of sending as their stamp.

    encoders: whose layout they speak. Raises DriverError where that cannot be spoken, or a fault not be shown in it.
    """

    def __init__(
        self,
        settings: SimulatedWheelSettings,
        encoders: EncoderSettings,
        start_ns: int,
        rng: np.random.Generator,
    ) -> None:
        self._settings = settings
        self._spoken = spoken_layout(encoders, settings)
        self._rng = rng
        self._nodes = {
            wheel: EncoderNode(wheel, settings, self._spoken, WheelOdometer(settings, factor, rng), start_ns)
            for wheel, factor in (
                (Wheel.LEFT, settings.left_radius_factor),
                (Wheel.RIGHT, settings.right_radius_factor),
            )
        }
        self._doubles: dict[Wheel, EncoderNode] = {}
        self._values: dict[str, float] = {}  # of a frame that carries both wheels
        self._active: list[ActiveFault] = []
        self._travel_m = dict.fromkeys(Wheel, 0.0)
        self._backward = dict.fromkeys(Wheel, False)
        for fault in settings.faults:
            self.inject(fault, start_ns)

    def inject(self, fault: WheelFault, now_ns: int) -> None:
        """Begin a fault, at once or when its time comes. Raises DriverError where the layout cannot show it."""
        self._spoken.check(fault)
        self._active.append(ActiveFault(fault, now_ns + round(fault.start_s * 1e9)))

    def clear(self, now_ns: int) -> list[CanFrame]:
        """End all faults; returns the error frames that a controller reports on that."""
        ended, self._active = self._active, []
        return self._end(ended, now_ns)

    def beat(self, wheel: Wheel, stamp_ns: int, travel_m: float) -> list[CanFrame]:
        """All frames that one node's beat puts on the bus. travel_m: true distance rolled since the start."""
        over = [active for active in self._active if active.is_over(stamp_ns)]
        self._active = [active for active in self._active if not active.is_over(stamp_ns)]
        extra = self._end(over, stamp_ns)
        on = [active for active in self._active if active.has_begun(stamp_ns)]
        names = {active.fault.kind for active in on if active.affects(wheel)}
        values = self._values_of(wheel, stamp_ns, travel_m, [active.fault for active in on if active.affects(wheel)])
        if "power_cycle" in names:
            return extra
        if self._spoken.shared and wheel is Wheel.LEFT:
            self._values = values  # both go out with the right wheel's beat
            return extra
        frames = [self._spoken.feedback[wheel].encode(self._values | values, stamp_ns)]
        for active in on:
            if active.affects(wheel) or self._spoken.shared:
                double = partial(self._double, wheel, stamp_ns, travel_m, active)
                frames = with_fault(frames, active, self._rng, double, self._spoken.feedback[wheel].crc_byte)
        if self._spoken.gear is not None and wheel is Wheel.RIGHT:
            frames.insert(0, self._spoken.gear.encode(all(self._backward.values()), stamp_ns))
        for active in on:
            error = error_frame(active.fault.kind, stamp_ns)
            if error is not None:
                frames = [error] * (ERROR_FRAMES_PER_BEAT if active.fault.kind == "error_flood" else 1)
        return extra + frames

    def info(self, wheel: Wheel, stamp_ns: int) -> list[CanFrame]:
        """The slow messages, unless the node is off or cut off."""
        counts_per_rev: float = self._settings.counts_per_rev
        for active in self._active:
            if not active.affects(wheel) or not active.has_begun(stamp_ns):
                continue
            if active.fault.kind in ("power_cycle", "silence", "silence_all", "bus_off", "error_flood"):
                return []
            if active.fault.kind == "wrong_counts_per_rev":
                counts_per_rev = active.fault.value
        return self._nodes[wheel].slow(stamp_ns, counts_per_rev)

    def true_count(self, wheel: Wheel) -> int:
        """Unwrapped count of this wheel since the start, free of faults: the truth for tests."""
        return self._nodes[wheel].true_count

    def _end(self, ended: list[ActiveFault], now_ns: int) -> list[CanFrame]:
        frames = []
        for active in ended:
            if active.fault.kind == "bus_off":
                frames.append(restarted_frame(now_ns))
            for wheel, node in self._nodes.items():
                if active.fault.kind == "power_cycle" and active.affects(wheel):
                    frames += node.reboot(now_ns, self._travel_m[wheel])
        return frames

    def _values_of(self, wheel: Wheel, stamp_ns: int, travel_m: float, faults: list[WheelFault]) -> dict[str, float]:
        """What this wheel's node says, with those of its faults that are its own."""
        self._backward[wheel] = travel_m < self._travel_m[wheel]
        self._travel_m[wheel] = travel_m
        status = next((fault.value for fault in faults if fault.kind == "status"), 0)
        jump = round(sum(fault.magnitude for fault in faults if fault.kind == "jump"))
        slip = sum(fault.share for fault in faults if fault.kind == "slip")
        names: set[str] = {fault.kind for fault in faults}
        return self._nodes[wheel].feedback(stamp_ns, travel_m, names, jump, status, slip)

    def _double(self, wheel: Wheel, stamp_ns: int, travel_m: float, active: ActiveFault) -> CanFrame:
        """A frame of the other node under the same id: it counts a wheel of its own."""
        if wheel not in self._doubles:
            odometer = WheelOdometer(self._settings, 1.0, self._rng)
            offset = round(active.fault.magnitude)
            double = EncoderNode(wheel, self._settings, self._spoken, odometer, stamp_ns, offset)
            double.boot_id, double.alive = active.fault.value % 16, 7
            self._doubles[wheel] = double
        later_ns = stamp_ns + 1_000_000
        values = self._doubles[wheel].feedback(later_ns, 0.6 * travel_m, set())
        return self._spoken.feedback[wheel].encode(values, later_ns)
