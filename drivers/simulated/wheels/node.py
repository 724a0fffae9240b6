"""The simulated encoder nodes on a real python-can bus: a thread that sends what the nodes say."""

import errno
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from drivers.canbus.bus import BusReadError, CanBus
from drivers.canbus.frame import CanFrame
from drivers.canbus.loopback import free_port
from drivers.measurements import LinkError
from drivers.settings.can import BusSettings
from drivers.settings.encoders import EncoderSettings
from drivers.settings.simulated_wheels import SimulatedWheelSettings, WheelFault
from drivers.simulated.wheels.encoder_nodes import EncoderNodes
from drivers.stoppable_thread import StoppableThread
from drivers.wheels.readings import Wheel

REOPEN_S = 0.2
GONE = (errno.ENODEV, errno.ENXIO, errno.EBADF)
BURST_ID = 0x321  # of no wheel


def is_for_the_node_to_pick(bus: BusSettings) -> bool:
    """Whether the simulated node shall take any port that is free."""
    return bus.interface == "udp_multicast" and bus.port == 0


class WheelNode:
    """Sends the wheels' frames every period and the nodes' own every second, in the layout of the encoders.

    tap: gets what was sent. travel_at: stamp_ns (of now_ns) to the true distance in m that the left and the right
    wheel have rolled.
    """

    def __init__(
        self,
        settings: SimulatedWheelSettings,
        encoders: EncoderSettings,
        travel_at: Callable[[int], tuple[float, float]],
        now_ns: Callable[[], int],
        rng: np.random.Generator,
    ) -> None:
        bus = encoders.bus
        self.bus = bus.model_copy(update={"port": free_port()}) if is_for_the_node_to_pick(bus) else bus
        self.tap: Callable[[CanFrame], None] | None = None
        self.frames_sent = 0
        self._settings = settings
        self._travel_at = travel_at
        self._now_ns = now_ns
        self._rng = rng
        self._nodes = EncoderNodes(settings, encoders, now_ns(), rng)
        self._burst = 0
        self._lock = threading.Lock()
        self._thread = StoppableThread("wheel node", self._run)
        self._link: CanBus | None = None

    def start(self) -> None:
        """Open the bus and begin to send. Raises LinkError if the bus is not there."""
        self._link = CanBus(self.bus, (), self._now_ns)
        self._thread.start()

    def inject(self, fault: WheelFault | dict[str, Any]) -> None:
        """Begin a fault; a dict is read as a WheelFault and pydantic's ValidationError names what is wrong.

        Raises DriverError for one that these wheels cannot show.
        """
        if not isinstance(fault, WheelFault):
            fault = WheelFault.model_validate(fault)
        with self._lock:
            if fault.kind == "burst":
                self._burst = round(fault.magnitude)
            else:
                self._nodes.inject(fault, self._now_ns())

    def clear(self) -> None:
        """End all faults."""
        with self._lock:
            frames = self._nodes.clear(self._now_ns())
        self._send(frames)

    def close(self) -> None:
        """Stop sending and leave the bus."""
        self._thread.stop()
        if self._link is not None:
            self._link.close()

    def _run(self) -> None:
        """A fixed grid of beats, left and right shifted; late beats are left out, as a node's timer would."""
        period_ns = round(self._settings.period_ms * 1e6)
        right_delay_ns = round(self._settings.right_delay_ms * 1e6)
        next_ns = next_info_ns = self._now_ns()
        while not self._thread.is_stopping():
            for wheel, delay_ns in ((Wheel.LEFT, 0), (Wheel.RIGHT, right_delay_ns)):
                jitter_ns = abs(self._rng.normal(0.0, self._settings.jitter_ms * 1e6))
                self._wait_until(next_ns + delay_ns + round(min(jitter_ns, 0.4 * period_ns)))
                self._beat(wheel)
            if self._now_ns() >= next_info_ns:
                next_info_ns += round(self._settings.info_period_s * 1e9)
                self._inform()
            next_ns += period_ns * max(1, -(-(self._now_ns() - next_ns) // period_ns))

    def _beat(self, wheel: Wheel) -> None:
        with self._lock:
            stamp_ns = self._now_ns()
            left_m, right_m = self._travel_at(stamp_ns)
            frames = self._nodes.beat(wheel, stamp_ns, left_m if wheel is Wheel.LEFT else right_m)
            frames += [CanFrame(stamp_ns, BURST_ID, bytes(8))] * self._burst
            self._burst = 0
        self._send(frames)

    def _inform(self) -> None:
        with self._lock:
            stamp_ns = self._now_ns()
            frames = [frame for wheel in Wheel for frame in self._nodes.info(wheel, stamp_ns)]
        self._send(frames)

    def _send(self, frames: list[CanFrame]) -> None:
        """Put frames on the bus; what does not go is lost, as on a real one, and a bus that is gone is opened anew."""
        for frame in frames:
            try:
                if self._link is None:
                    self._link = CanBus(self.bus, (), self._now_ns)
                self._link.send(frame)
                self.frames_sent += 1
                if self.tap is not None:
                    self.tap(frame)
            except LinkError as error:
                if not isinstance(error, BusReadError) or error.number in GONE:
                    if self._link is not None:
                        self._link.close()
                    self._link = None
                    self._thread.wait(REOPEN_S)
                    return

    def _wait_until(self, deadline_ns: int) -> None:
        remaining_ns = deadline_ns - self._now_ns()
        if remaining_ns > 0:
            self._thread.wait(remaining_ns * 1e-9)
