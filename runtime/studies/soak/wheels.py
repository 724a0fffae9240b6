"""The simulated wheel nodes on a virtual CAN bus, sending what is due whenever they are told how late it is."""

from collections import deque
from collections.abc import Callable

import can
import numpy as np

from drivers.canbus.bus import message_of
from drivers.canbus.frame import CanFrame
from drivers.settings.encoders import EncoderSettings
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.simulated.wheels.encoder_nodes import EncoderNodes
from drivers.wheels.readings import Wheel

JITTER_MAX = 0.4  # of the period


class SteppedWheels:
    """The same frames as the node of a simulated rover sends; a frame's stamp is the moment when it was due.

    encoders: whose layout they speak, on the virtual bus of its channel. travel_at: stamp_ns to the true distance in m
    that the left and the right wheel have rolled.
    newest_ns: stamp of the newest frame of each wheel that was sent.
    """

    def __init__(
        self,
        settings: SimulatedWheelSettings,
        encoders: EncoderSettings,
        travel_at: Callable[[int], tuple[float, float]],
        start_ns: int,
        rng: np.random.Generator,
    ) -> None:
        self.newest_ns: dict[Wheel, int] = {}
        self._settings = settings
        self._travel_at = travel_at
        self._rng = rng
        self._nodes = EncoderNodes(settings, encoders, start_ns, rng)
        channel = encoders.bus.channel
        self._bus = can.Bus(interface="virtual", channel=channel, preserve_timestamps=True, ignore_config=True)
        self._due: deque[tuple[Wheel | None, CanFrame]] = deque()
        self._next_ns = self._next_info_ns = start_ns

    def send_until(self, until_ns: int) -> None:
        """Send all frames that are due by then."""
        period_ns = round(self._settings.period_ms * 1e6)
        while self._next_ns <= until_ns:
            self._beat(self._next_ns, period_ns)
            self._next_ns += period_ns
        while self._due and self._due[0][1].stamp_ns <= until_ns:
            wheel, frame = self._due.popleft()
            message = message_of(frame)
            message.timestamp = frame.stamp_ns * 1e-9
            self._bus.send(message)
            if wheel is not None:
                self.newest_ns[wheel] = frame.stamp_ns

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()

    def _beat(self, beat_ns: int, period_ns: int) -> None:
        delays_ns = {Wheel.LEFT: 0, Wheel.RIGHT: round(self._settings.right_delay_ms * 1e6)}
        stamp_ns = beat_ns
        for wheel, delay_ns in delays_ns.items():
            jitter_ns = round(min(abs(self._rng.normal(0.0, self._settings.jitter_ms * 1e6)), JITTER_MAX * period_ns))
            stamp_ns = max(stamp_ns, beat_ns + delay_ns + jitter_ns)
            left_m, right_m = self._travel_at(stamp_ns)
            frames = self._nodes.beat(wheel, stamp_ns, left_m if wheel is Wheel.LEFT else right_m)
            self._due.extend((wheel, frame) for frame in frames)
        if beat_ns >= self._next_info_ns:
            self._next_info_ns += round(self._settings.info_period_s * 1e9)
            self._due.extend((None, frame) for wheel in Wheel for frame in self._nodes.info(wheel, stamp_ns))
