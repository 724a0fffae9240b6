"""Where a laser could be and what answers there; which CAN interfaces there are and what is heard on them."""

import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drivers.canbus.bus import CanBus, NotAFrameError
from drivers.canbus.frame import CanFrame
from drivers.laser.hokuyo import Hokuyo
from drivers.settings.can import BusSettings
from drivers.settings.laser import LaserSettings

HOKUYO_USB = 0x15D1
FACTORY_URL = LaserSettings().url
UDEV_NAME = Path("/dev/infant/lidar")
INTERFACES = Path("/sys/class/net")
CAN_TYPE = "280"  # ARPHRD_CAN
ANSWER_S = 6.0  # a sensor with Ethernet has started, connected and sent a scan
OTHERS_S = 1.0  # after the first has answered: a second laser would be used by mistake
POLL_S = 0.05
MOST_FRAMES = 200_000


@dataclass(frozen=True, slots=True)
class LaserFound:
    """A laser that answered VV, PP and II and sent a scan. Angles: first and last beam, counter-clockwise.

    others: addresses at which further lasers answered.
    """

    url: str
    model: str
    firmware: str
    serial_number: str
    beams: int
    first_deg: float
    last_deg: float
    range_max_m: float
    others: tuple[str, ...] = ()

    def line(self) -> str:
        """For a person."""
        return (
            f"{self.model} at {self.url}: firmware {self.firmware}, serial number {self.serial_number}, {self.beams} "
            f"beams from {self.first_deg:.0f} to {self.last_deg:.0f} degrees, up to {self.range_max_m:g} m"
            + "".join(f"; another laser answers at {url}: give --laser {url} to use that one" for url in self.others)
        )

    def as_json(self) -> dict[str, Any]:
        """As --json prints it."""
        return asdict(self)


def laser_urls() -> list[str]:
    """Where a Hokuyo can be: ports with its maker's USB number, Infant's udev name, the address from the factory."""
    from serial.tools.list_ports import comports

    paths = [UDEV_NAME] if UDEV_NAME.exists() else []
    ports = (Path(port.device) for port in comports() if port.vid == HOKUYO_USB)
    paths += [port for port in ports if port != UDEV_NAME.resolve()]
    return [*(f"serial://{path}" for path in paths), FACTORY_URL]


def find_laser(urls: Sequence[str], wait_s: float = ANSWER_S) -> LaserFound | None:
    """The first of these that sends a scan; all are asked at once. Nothing is written to any other port."""
    lasers = {url: Hokuyo(LaserSettings(url=url), time.monotonic_ns) for url in urls}
    found: dict[str, LaserFound] = {}
    pause, polls = threading.Event(), round(wait_s / POLL_S)
    try:
        for laser in lasers.values():
            laser.start()
        while polls > 0 and len(found) < len(lasers):
            for url, laser in lasers.items():
                answer = _answer(url, laser)
                if answer is not None and url not in found:
                    found[url] = answer
                    polls = min(polls, round(OTHERS_S / POLL_S))
            polls -= 1
            pause.wait(POLL_S)
    finally:
        for laser in lasers.values():
            laser.close()
    first, *others = [url for url in lasers if url in found] or [""]
    return replace(found[first], others=tuple(others)) if found else None


def _answer(url: str, laser: Hokuyo) -> LaserFound | None:
    """What it says of itself once it has sent a scan."""
    scan, facts = laser.latest(), laser.health().facts
    if scan is None or "model" not in facts:
        return None
    first, last = np.rad2deg(scan.bearings_rad[[0, -1]]).tolist()
    names = (facts["model"], facts.get("firmware", "unknown"), facts.get("serial_number", "unknown"))
    return LaserFound(url, *names, scan.bearings_rad.size, first, last, scan.range_max_m)


def can_interfaces(folder: Path = INTERFACES) -> list[str]:
    """Names of the SocketCAN interfaces of this machine."""
    kinds = ((path.name, path / "type") for path in sorted(folder.glob("*")))
    return [name for name, kind in kinds if kind.is_file() and kind.read_text().strip() == CAN_TYPE]


def bus_named(text: str) -> BusSettings:
    """can0, or INTERFACE:CHANNEL[:PORT] as python-can names them. Raises pydantic.ValidationError, ValueError."""
    interface, colon, rest = text.partition(":")
    if not colon:
        return BusSettings(interface="socketcan", channel=text)
    channel, colon, port = rest.partition(":")
    return BusSettings(interface=interface, channel=channel, port=int(port) if colon else 0)


def hear(bus: BusSettings, seconds: float) -> list[CanFrame]:
    """All frames of some seconds; nothing is sent. Raises LinkError where the bus cannot be opened or read."""
    link, frames = CanBus(bus, None, time.monotonic_ns), list[CanFrame]()
    end_ns = time.monotonic_ns() + round(seconds * 1e9)
    try:
        while (left_ns := end_ns - time.monotonic_ns()) > 0 and len(frames) < MOST_FRAMES:
            try:
                frame = link.receive(left_ns * 1e-9)
            except NotAFrameError:
                continue
            if frame is not None:
                frames.append(frame)
    finally:
        link.close()
    return frames
