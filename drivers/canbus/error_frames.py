"""Error frames of SocketCAN (include/uapi/linux/can/error.h) and the state of the controller that they tell."""

from enum import StrEnum

TX_TIMEOUT, LOST_ARBITRATION, CONTROLLER, PROTOCOL = 0x001, 0x002, 0x004, 0x008
TRANSCEIVER, NO_ACK, BUS_OFF, BUS_ERROR, RESTARTED = 0x010, 0x020, 0x040, 0x080, 0x100
CLASSES = {
    TX_TIMEOUT: "tx_timeout",
    LOST_ARBITRATION: "lost_arbitration",
    PROTOCOL: "protocol",
    TRANSCEIVER: "transceiver",
    NO_ACK: "no_ack",
    BUS_OFF: "bus_off",
    BUS_ERROR: "bus_error",
    RESTARTED: "restarted",
}
RX_OVERFLOW, TX_OVERFLOW, WARNING_BITS, PASSIVE_BITS, ACTIVE = 0x01, 0x02, 0x0C, 0x30, 0x40  # byte 1
GOOD_FRAMES = 10  # of a controller that says nothing more: it is well again


class BusCondition(StrEnum):
    """What the controller may do (ISO 11898-1, fault confinement)."""

    ACTIVE = "error-active"
    WARNING = "error-warning"
    PASSIVE = "error-passive"
    OFF = "bus-off"


class ErrorFrames:
    """Follows the controller's state. python-can's bus.state stays ACTIVE whatever happens on SocketCAN."""

    def __init__(self) -> None:
        self.condition = BusCondition.ACTIVE
        self.since_good = 0
        self._good = 0

    def error(self, error_class: int, data: bytes) -> tuple[str, ...]:
        """Take one error frame; returns the names of what it says."""
        self.since_good += 1
        self._good = 0
        names = [name for bit, name in CLASSES.items() if error_class & bit]
        if error_class & CONTROLLER:
            names += self._controller(data[1] if len(data) > 1 else 0)
        if error_class & BUS_OFF:
            self.condition = BusCondition.OFF
        elif error_class & RESTARTED:
            self.condition = BusCondition.ACTIVE
        return tuple(names) or ("unspecified",)

    def good_frame(self) -> None:
        """Take note of a frame that came through: a controller that is off receives none."""
        self.since_good = 0
        if self.condition is BusCondition.ACTIVE:
            return
        self._good += 1
        if self.condition is BusCondition.OFF or self._good >= GOOD_FRAMES:
            self.condition = BusCondition.ACTIVE

    def reopened(self) -> None:
        """A new session knows nothing of the controller."""
        self.condition, self.since_good, self._good = BusCondition.ACTIVE, 0, 0

    def _controller(self, status: int) -> list[str]:
        names = []
        if status & RX_OVERFLOW:
            names.append("rx_overflow")
        if status & TX_OVERFLOW:
            names.append("tx_overflow")
        if status & WARNING_BITS:
            names.append("warning")
            self.condition = BusCondition.WARNING
        if status & PASSIVE_BITS:
            names.append("passive")
            self.condition = BusCondition.PASSIVE
        if status & ACTIVE:
            names.append("active")
            self.condition = BusCondition.ACTIVE
        return names
