"""What the simulated devices sent, in a folder as `infant import` reads it: laser.logr and wheels.candump."""

import struct
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from drivers.canbus.frame import ERROR, EXTENDED, REMOTE, CanFrame
from runtime.errors import RunExistsError, StorageError

RECORD = struct.Struct(">III")  # seconds, microseconds, length, as in .logr of hokuyoaist
ERROR_FLAG = 0x20000000


class SentBytes:
    """Two files in a new folder; each device's thread writes its own."""

    def __init__(self, folder: Path) -> None:
        """Raises RunExistsError where the folder is there, StorageError where it cannot be made."""
        try:
            folder.mkdir(parents=True)
            self._laser = (folder / "laser.logr").open("xb")
            self._wheels = (folder / "wheels.candump").open("x", encoding="ascii")
        except FileExistsError as error:
            raise RunExistsError(f"{folder} exists; nothing is overwritten; give another name") from error
        except OSError as error:
            raise StorageError(
                f"{folder} cannot be created ({error.strerror}); give another folder with --record"
            ) from error
        self._lock = threading.Lock()  # the laser answers over two ports

    def laser(self, data: bytes) -> None:
        """One reply of the laser, which goes out now."""
        now_us = time.time_ns() // 1000
        with self._lock:
            self._laser.write(RECORD.pack(now_us // 1_000_000, now_us % 1_000_000, len(data)) + data)

    def wheels(self, frame: CanFrame) -> None:
        """One frame of the wheels, which has gone out."""
        number = frame.arbitration_id | (ERROR_FLAG if frame.flags & ERROR else 0)
        digits = f"{number:08X}" if frame.flags & (ERROR | EXTENDED) else f"{number:03X}"
        data = "R" if frame.flags & REMOTE else frame.data.hex().upper()
        self._wheels.write(f"({time.time_ns() / 1e9:.6f}) can0 {digits}#{data}\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._laser.close()
        self._wheels.close()
