"""One wheel: its counter, its history, and what its node says of itself."""

from drivers.events import EventLog
from drivers.measurements import Severity
from drivers.settings.encoders import EncoderSettings, WheelSettings
from drivers.wheels.counter import WheelCounter
from drivers.wheels.history import WheelHistory
from drivers.wheels.leaky_bucket import LeakyBucket
from drivers.wheels.readings import NodeInfo, Wheel, WheelDecoder, WheelReading
from drivers.wheels.speed import SpeedIntegrator

STUCK_TRAVEL_M = 0.5  # travel of one wheel during which the other stands still that is reported
INTERPOLATED_PERIODS, INTERPOLATED_AT_LEAST_NS = 5, 60_000_000  # a longer gap is no straight line
GEAR_NS = 2_500_000_000  # a gear that has been silent for longer is not known; most are sent each second at least
OPERATIONAL = 5
REASONS = {
    "crc": "checksums are wrong; check cable and termination, and that no other node uses this id",
    "undecodable": "frames cannot be decoded, for example because of a multiplexer value that the layout lacks; check "
    "the layout",
    "not_available": "the node says that it has no count (all ones); see its manual",
    "not_finite": "the count or the speed is not a number (NaN); check the program of the node",
    "out_of_range": "the count or the speed is outside the range that the DBC gives it; check both",
    "direction": "the wheel turns and nothing says which way; check the signal or message that direction names",
    "length": "the length of the frames differs from that of the layout; check the layout",
    "standard": "frames have an 11-bit id where 29 bits are expected; check the layout",
    "extended": "frames have a 29-bit id where 11 bits are expected; check the layout",
    "remote": "remote frames request this id; find the node that sends them",
    "fd": "CAN FD frames arrive under this id; check the layout",
    "status": "the node says that its counts are not valid",
    "alive_frozen": "the rolling counter stands still while the count changes; the program of the node hangs",
    "jump": "the count moves faster than the rover can; check vehicle.counts_per_rev and the encoder",
    "too_soon": "the rolling counter runs ahead of time; perhaps two nodes send under this id",
    "speed_disagrees": "count and speed signal disagree; check the encoder",
    "stuck": "the count stands still while the speed signal does not; check the encoder",
    "two_senders": "two nodes send under this id; give each node its own",
    "unconfirmed": "frames with another boot id arrive; the node restarts or has a duplicate",
    "out_of_order": "frames arrive late",
    "duplicate": "frames arrive twice",
}
CHECK_POWER = "check power and cable of the node"
BENIGN = ("duplicate", "out_of_order", "unconfirmed")


class WheelState:
    """One wheel as the pair sees it. Counters are by reason; `stuck` is a suspicion, not a fault."""

    def __init__(
        self,
        wheel: Wheel,
        settings: EncoderSettings,
        own: WheelSettings,
        frames: WheelDecoder,
        events: EventLog,
    ) -> None:
        self.wheel = wheel
        self.counter: WheelCounter | SpeedIntegrator = (
            WheelCounter(settings, own.sign, frames.modulus[wheel], frames.alive_modulus[wheel])
            if frames.has_position
            else SpeedIntegrator(settings, own.sign)
        )
        self.counters = self.counter.counters
        self.history = WheelHistory(max(INTERPOLATED_PERIODS * settings.period_ns, INTERPOLATED_AT_LEAST_NS))
        self.bad_frames = LeakyBucket(5)
        self.stuck = False
        self.wake_up_wanted = False
        self.lost_at_ns: int | None = None
        self._settings = settings
        self._events = events
        self._silent_ns = settings.silent_ns
        self._has_gear = wheel in frames.gears
        self._gear: tuple[int, int] | None = None
        self._refused: tuple[int, str] | None = None
        self._uptime_ms: int | None = None
        self._misconfigured = ""
        self._not_operational = ""
        self._alarm = ""
        self._rest: tuple[float, float] | None = None

    def fault(self, now_ns: int) -> str:
        """Why this wheel's counts must not be used now; empty: they are good."""
        said = self._misconfigured or self._alarm or self._not_operational
        if said:
            return said
        if self.counter.two_senders:
            return REASONS["two_senders"]
        if self.bad_frames.full:
            return REASONS[self._refused[1] if self._refused is not None else "crc"]
        if self.counter.frozen.full:
            return REASONS["alive_frozen"]
        age_ns = self.age_ns(now_ns)
        if age_ns is not None and age_ns > self._silent_ns:
            return f"silent: no good frame for {age_ns * 1e-9:.1f} s; {self.refusal(now_ns) or CHECK_POWER}"
        return ""

    def refusal(self, now_ns: int) -> str:
        """Why the frames that do come are of no use; empty where none has come lately."""
        if self._refused is None or now_ns - self._refused[0] > self._silent_ns:
            return ""
        return REASONS[self._refused[1]]

    def age_ns(self, now_ns: int) -> int | None:
        """Time since the last good frame; None before the first."""
        return None if self.counter.stamp_ns is None else now_ns - self.counter.stamp_ns

    def note(self, stamp_ns: int, kind: str, text: str, severity: Severity = Severity.WARN) -> None:
        """An event that names this wheel, whose own counters count it."""
        key = f"{self.wheel} {kind}"
        self._events.add(stamp_ns, kind, f"{self.wheel} wheel: {text}", severity, amount=0, key=key)

    def refuse(self, stamp_ns: int, reason: str) -> None:
        """An event for a refused frame; the counter has been counted already."""
        if reason not in BENIGN:
            self._refused = stamp_ns, reason
        self.note(stamp_ns, reason, REASONS[reason], Severity.INFO if reason in BENIGN else Severity.WARN)

    def shift(self, stamp_ns: int, direction: int) -> None:
        """Take what another message says of the direction."""
        self._gear = stamp_ns, direction

    def directed(self, stamp_ns: int, reading: WheelReading) -> WheelReading:
        """A reading with the direction that another message gives it, where the layout names one."""
        if not self._has_gear:
            return reading
        is_known = self._gear is not None and stamp_ns - self._gear[0] <= GEAR_NS
        return reading._replace(direction=self._gear[1] if is_known and self._gear is not None else 0)

    def compare_travel(self, own: float, other: float, stamp_ns: int) -> None:
        """Suspect a wheel that stands still while the other rolls on; a turn about one wheel does so, for a while."""
        if self._rest is None or own != self._rest[0]:
            self._rest, self.stuck = (own, other), False
        elif not self.stuck and abs(other - self._rest[1]) > STUCK_TRAVEL_M * self._settings.counts_per_metre:
            self.stuck = True
            self.counters["still"] += 1
            self.note(
                stamp_ns,
                "still",
                f"no count while the other wheel rolled {STUCK_TRAVEL_M:g} m",
            )

    def inform(self, stamp_ns: int, info: NodeInfo) -> None:
        """The node's slow message: refuse to use a node that is not the one configured."""
        expected = self._settings.vehicle.counts_per_rev
        if info.counts_per_rev is not None and info.counts_per_rev != expected:
            self.counters["configuration"] += 1
            self._misconfigured = (
                f"the node has {info.counts_per_rev} counts per turn but vehicle.counts_per_rev is "
                f"{expected:g}; set vehicle.counts_per_rev to the right one"
            )
        else:
            self._misconfigured = ""
        if info.period_ms is not None and info.period_ms != self._settings.period_ms:
            self.counters["period"] += 1
            text = f"the node sends every {info.period_ms} ms but period_ms is {self._settings.period_ms:g}"
            self.note(stamp_ns, "period", text + "; make them equal")
        if info.uptime_ms is not None:
            if self._uptime_ms is not None and info.uptime_ms < self._uptime_ms:
                self.counters["restart"] += 1
                self.note(stamp_ns, "restart", f"the node has restarted {info.uptime_ms} ms ago")
            self._uptime_ms = info.uptime_ms

    def node_state(self, stamp_ns: int, state: int) -> None:
        """CANopen heartbeat; a boot-up message comes before the first count of a node that starts at 0 again."""
        self._not_operational = ""
        if state == OPERATIONAL:
            return
        self.wake_up_wanted = True
        if state == 0:
            self.counters["power_cycle"] += 1
            self.counter.restart()
            self.note(stamp_ns, "restart", "the node has booted")
        else:
            self.counters["not_operational"] += 1
            self._not_operational = f"the node is in state {state}, not operational; send it NMT start"

    def node_alarm(self, stamp_ns: int, code: int) -> None:
        """CANopen emergency: no motion is known until the node takes it back."""
        if code == 0:
            self._alarm = ""
            return
        self.counters["emergency"] += 1
        self.counter.restart()
        self._alarm = f"the node reports emergency 0x{code:04X}; see its manual"
        self.note(stamp_ns, "emergency", self._alarm, Severity.ERROR)
