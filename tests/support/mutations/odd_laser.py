"""A simulated laser behind a bad cable, or one that means harm: its replies are changed on their way."""

import numpy as np
import pytest

from drivers.laser import connect
from drivers.laser.hokuyo import Hokuyo
from drivers.measurements import DriverError, LinkError
from drivers.settings.laser import LaserSettings
from drivers.simulated.laser.motor import LaserMotor
from drivers.simulated.laser.profiles import PROFILES
from drivers.simulated.laser.protocol import LaserProtocol, State, Sweep
from tests.support.mutations.wire_bytes import mutated

PROFILE = PROFILES["UTM-X001S"]
PERIOD_NS = 100_000_000
START_NS = 10**12
REPLIES = 60  # of a session, then the cable is pulled
URL = LaserSettings(url="tcp://127.0.0.1:1")


class OddLaser:
    """A link to a simulated laser whose replies are changed on their way, in a time that passes by reading alone."""

    replies = 0
    scans = 0

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.share = float(self.rng.choice([0.02, 0.2, 0.9]))
        self.now_ns = START_NS
        motor = LaserMotor(PROFILE.parameters, 20.0, 1.0, 5000, self.now_ns)
        self.motor = motor
        self.protocol = LaserProtocol(PROFILE, motor, self._sweep)
        self.waiting: list[bytes] = []
        self.left = REPLIES

    def _sweep(self) -> Sweep:
        codes = self.rng.integers(0, 70_000, 1081).astype(np.int32)
        return Sweep(self.motor.counter_ms(self.now_ns), codes)

    def read(self, timeout_s: float) -> bytes:
        self.left -= 1
        if self.left < 0:
            raise LinkError("pulled")
        if self.waiting:
            self.now_ns += 200_000
            return self.waiting.pop(0)
        if self.protocol.state is State.MULTI:
            self.now_ns += PERIOD_NS
            return self._changed(self.protocol.scan(self._sweep()))
        self.now_ns += max(1_000_000, round(timeout_s * 1e9))
        return b""

    def write(self, data: bytes) -> None:
        for line in data.split(b"\n")[:-1]:
            if answer := self.protocol.reply(line, self.now_ns):
                self.waiting.append(self._changed(answer))

    def close(self) -> None:
        self.left = -1

    def _changed(self, answer: bytes) -> bytes:
        OddLaser.replies += 1
        return mutated(answer, self.rng) if self.rng.random() < self.share else answer


def check_session(seed: int) -> None:
    """Two sessions of a driver with such a laser: each ends with an error of the family, no nonsense is believed."""
    link = OddLaser(seed)
    driver = Hokuyo(URL, lambda: link.now_ns)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(connect, "TcpLink", lambda *_: link)
        for _ in range(2):
            link.left = REPLIES
            with pytest.raises(DriverError) as ended:
                driver._connect_and_run()
            assert "\n" not in str(ended.value)
            scan = driver.latest()
            OddLaser.scans += scan is not None
            assert scan is None or START_NS - PERIOD_NS < scan.stamp_ns < link.now_ns + 2_000_000
    health = driver.health()
    assert all(text.isprintable() for text in (health.reason, *health.facts.values()))
    assert all(event.reason.isprintable() for event in driver.drain_events())
