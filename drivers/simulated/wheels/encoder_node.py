"""One simulated encoder node as pure state: time and true travel in, what it would say out."""

from drivers.canbus.frame import CanFrame
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.simulated.wheels.odometer import WheelOdometer
from drivers.simulated.wheels.spoken_layout import SpokenLayout
from drivers.wheels.readings import NodeInfo, Wheel

SCHEMA_VERSION = 1
HEARTBEAT, BOOT_UP, OPERATIONAL = 0x700, 0, 5  # CiA 301, 7.2.8.3.2


class EncoderNode:
    """Counts one wheel, and says so in its layout."""

    def __init__(
        self,
        wheel: Wheel,
        settings: SimulatedWheelSettings,
        spoken: SpokenLayout,
        odometer: WheelOdometer,
        start_ns: int,
        offset: int = 0,
    ) -> None:
        self.wheel = wheel
        self.boot_id = settings.start_boot_id
        self.alive = 0
        self.true_count = 0
        self._settings = settings
        self._signals = spoken.signals[wheel]
        self._feedback = spoken.feedback[wheel]
        self._info = spoken.info.get(wheel)
        self._canopen = spoken.canopen.get(wheel)
        self._modulus = spoken.modulus[wheel]
        self._sign = spoken.signs[wheel]
        self._odometer = odometer
        self._offset = offset + (settings.start_count if self._modulus else 0)  # a float has no top to wrap at
        self._sent: tuple[int, int, float] | None = None  # stamp, count and exact count of the beat before
        self._booted_ns = start_ns

    def feedback(
        self, stamp_ns: int, travel_m: float, faults: set[str], jump: int = 0, status: int = 0, slip: float = 0.0
    ) -> dict[str, float]:
        """Raw values of this beat. faults: names of those that change what the node says; slip: share of the way."""
        count, exact = self._odometer.count(travel_m, slip), self._odometer.exact_count
        before_ns, before, before_exact = self._sent if self._sent is not None else (0, count, exact)
        self._sent, self.true_count = (stamp_ns, count, exact), count
        if self._signals.speed_unit == "counts_per_period":
            speed = (count - before) * 1e3 / self._settings.period_ms
        else:
            speed = (exact - before_exact) * 1e9 / max(1, stamp_ns - before_ns)
        if "stuck" in faults:
            # the register stands still, so the pulses of this beat are lost for good
            self._offset -= self._sign * (count - before)
            speed = speed if self._signals.count else 0.0
        position: float = self._sign * count + self._offset + jump
        values = self._feedback.motion(position % self._modulus if self._modulus else position, self._sign * speed)
        said = {
            self._signals.status: status if status else self._signals.status_ok[0],
            self._signals.alive: self.alive % max(1, self._feedback.alive_modulus),
            self._signals.boot_id: self.boot_id,
        }
        if "alive_frozen" not in faults:
            self.alive += 1
        return values | {name: value for name, value in said.items() if name}

    def slow(self, stamp_ns: int, counts_per_rev: float) -> list[CanFrame]:
        """What the node says of itself from time to time."""
        frames = []
        if self._info is not None:
            uptime_ms = (stamp_ns - self._booted_ns) // 1_000_000
            period_ms = round(self._settings.period_ms)
            said = NodeInfo(self.wheel, round(counts_per_rev), period_ms, SCHEMA_VERSION, uptime_ms)
            frames.append(self._info.encode(said, stamp_ns))
        if self._canopen is not None:
            frames.append(CanFrame(stamp_ns, HEARTBEAT + self._canopen, bytes((OPERATIONAL,))))
        return frames

    def reboot(self, stamp_ns: int, travel_m: float) -> list[CanFrame]:
        """Power comes back: the count begins at 0, the boot id is the next, and a CANopen node says that it booted."""
        self._offset = -self._sign * self._odometer.count(travel_m)
        self._sent = None
        self._booted_ns = stamp_ns
        self.boot_id = (self.boot_id + 1) % 16
        self.alive = 0
        return [] if self._canopen is None else [CanFrame(stamp_ns, HEARTBEAT + self._canopen, bytes((BOOT_UP,)))]
