"""A simulated rover whose time is the loop's: real bytes on TCP and on a CAN bus, and nothing of it is ever late."""

import threading
import time
from collections.abc import Callable, Mapping

import numpy as np

from drivers.measurements import Encoders, Laser
from drivers.settings.encoders import EncoderSettings
from drivers.settings.laser import LaserSettings
from drivers.settings.simulation import SimulationSettings
from drivers.simulated.laser.device import LaserDevice
from drivers.simulated.rover import FAR_NS, WHEEL_STREAM, world_for
from drivers.simulated.world.places.choose import world_of
from runtime.studies.soak.clock import Leap
from runtime.studies.soak.scans_ahead import ScansAhead
from runtime.studies.soak.wheels import SteppedWheels
from runtime.tick import Sink
from slam.pose import Pose2

CHANNEL = "infant-soak"
BEFORE_START_S = 0.01
POLL_S = 1e-4
HAND_OVER_S = 0.25
DEEP = 400  # values in the queue of a sink; at ten times life's pace 150 gather between two wakes of the recorder
DEEP_BY_SINK = {"publish": 10}  # of the 20 ticks that it keeps
SINKS_S, SINKS_POLL_S = 30.0, 0.005
NEWEST_S = 2e-3  # ages of frames are told with the uncertainty of their arrival


class SteppedRover:
    """Until `start_world` it lives at life's pace; then `live_until` is its only time.

    laser, encoders: the settings by which the drivers reach it. not_taken: how often a driver did not take what was
    sent within a quarter of a second; waited_s: for sinks with too much in their queues, which cannot be on a rover.
    """

    def __init__(
        self,
        simulation: SimulationSettings,
        laser: LaserSettings,
        encoders: EncoderSettings,
        now_ns: Callable[[], int],
        hand_over_s: float = HAND_OVER_S,
    ) -> None:
        """hand_over_s: after this long in real time the drivers are not waited for."""
        settings = world_for(simulation)
        self.not_taken, self.waited_s = 0, 0.0
        self._closed = False
        self._hand_over_s = hand_over_s
        self._now_ns = now_ns
        self._world = world_of(settings)
        self._start_ns: int | None = None
        self._sweeps = ScansAhead(settings)
        self._device = LaserDevice(simulation.laser, lambda t_ns: self._sweeps.at(self._world_ns(t_ns)), now_ns)
        bus = encoders.bus.model_copy(update={"interface": "virtual", "channel": CHANNEL, "options": {}})
        self.encoders = encoders.model_copy(update={"bus": bus})
        self._wheels = SteppedWheels(
            simulation.wheels,
            self.encoders,
            lambda t_ns: self._world.wheel_travel_m(self._world_ns(t_ns)),
            now_ns(),
            np.random.default_rng([simulation.world.seed, WHEEL_STREAM]),
        )
        self._drivers: tuple[Laser, Encoders] | None = None
        self._sinks: Mapping[str, Sink] = {}
        self._driving = threading.Event()
        self._before = threading.Thread(target=self._live_before, name="soak", daemon=True)
        self._device.start()
        self._before.start()
        self.laser = laser.model_copy(update={"url": self._device.pty_url or self._device.url})

    def meet(self, laser: Laser, encoders: Encoders, sinks: Mapping[str, Sink]) -> None:
        """Those who have to take what they get before time goes on: the threads of the sinks have no leaping clock."""
        self._drivers, self._sinks = (laser, encoders), sinks

    def start_world(self, start_ns: int) -> None:
        """Let the world begin at this time."""
        self._stop_before()
        self._start_ns = start_ns

    def map_from_body(self, stamp_ns: int) -> Pose2 | None:
        """The truth; None before the world has begun."""
        if self._start_ns is None:
            return None
        return Pose2(*self._world.map_from_body(max(0, stamp_ns - self._start_ns)))

    def live_until(self, deadline_ns: int, leap: Leap) -> None:
        """Send the scans and frames that are due until then, each at its time, and wait until the drivers have them."""
        while (due_ns := self._device.next_scan_ns) is not None and due_ns <= deadline_ns:
            leap(due_ns)
            if not self._send_scan(due_ns):
                break
        leap(deadline_ns)
        self._wheels.send_until(deadline_ns)
        self._await(self._has_frames)
        until_s = time.monotonic() + SINKS_S
        while self._is_behind() and time.monotonic() < until_s:
            time.sleep(SINKS_POLL_S)
            self.waited_s += SINKS_POLL_S

    def _is_behind(self) -> bool:
        return any(sink.health().depth > DEEP_BY_SINK.get(name, DEEP) for name, sink in self._sinks.items())

    def close(self) -> None:
        """Release everything; a second time nothing."""
        if self._closed:
            return
        self._closed = True
        self._stop_before()
        self._device.close()
        self._wheels.close()
        self._sweeps.close()

    def _send_scan(self, due_ns: int) -> bool:
        before = self._scans()
        self._device.recheck_clock()
        return self._await(lambda: self._device.next_scan_ns != due_ns and self._scans() > before)

    def _scans(self) -> int:
        assert self._drivers is not None
        return self._drivers[0].health().counters.get("scans", 0)

    def _has_frames(self) -> bool:
        assert self._drivers is not None
        ages_s, now_ns = self._drivers[1].health().figures, self._now_ns()
        sent_s = {wheel: (now_ns - stamp_ns) * 1e-9 for wheel, stamp_ns in self._wheels.newest_ns.items()}
        return all(ages_s.get(f"{wheel}_age_s", np.inf) <= age_s + NEWEST_S for wheel, age_s in sent_s.items())

    def _await(self, is_taken: Callable[[], bool]) -> bool:
        until_s = time.monotonic() + self._hand_over_s
        while not is_taken():
            if time.monotonic() > until_s:
                self.not_taken += 1
                return False
            time.sleep(POLL_S)
        return True

    def _live_before(self) -> None:
        while not self._driving.wait(BEFORE_START_S):
            self._wheels.send_until(self._now_ns())

    def _stop_before(self) -> None:
        self._driving.set()
        self._before.join()

    def _world_ns(self, stamp_ns: int) -> int:
        """Time of the world; far before its beginning until start_world(): the rover stands, the noise is alive."""
        return stamp_ns - (FAR_NS if self._start_ns is None else self._start_ns)
