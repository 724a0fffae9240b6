"""Log files of `candump -l` (can-utils) by python-can, as frames of the driver and onto a bus again."""

from collections.abc import Iterator
from pathlib import Path

import can

from drivers.canbus.bus import CanBus, frame_of
from drivers.canbus.frame import CanFrame


def read_candump(path: Path) -> Iterator[CanFrame]:
    """Frames of the file; stamp_ns is the time in the file. python-can drops the class of an error frame."""
    with can.CanutilsLogReader(path) as log:
        for message in log:
            yield frame_of(message, round(message.timestamp * 1e6) * 1000)


def replay_candump(path: Path, bus: CanBus, speed: float) -> int:
    """Send the file over an open bus, `speed` times as fast as it was recorded; returns the number of frames."""

    def sped_up() -> Iterator[can.Message]:
        with can.CanutilsLogReader(path) as log:
            for message in log:
                message.timestamp /= speed
                yield message

    sent = 0
    for message in can.MessageSync(sped_up()):
        bus.send(frame_of(message, 0))
        sent += 1
    return sent
