"""What the simulated devices sent, in a folder as `infant import` reads it: laser.logr and wheels.candump."""

import struct
import threading
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from drivers.canbus.frame import ERROR, EXTENDED, REMOTE, CanFrame
from runtime.atomic_write import make_folder, take_away
from runtime.errors import RunExistsError, StorageError

RECORD = struct.Struct(">III")  # seconds, microseconds, length, as in .logr of hokuyoaist
ERROR_FLAG = 0x20000000


class SentBytes:
    """Two files in a new folder; each device's thread writes its own."""

    def __init__(self, folder: Path, stop: threading.Event) -> None:
        """stop: set where a file cannot be written. Raises RunExistsError where the folder is there, StorageError where
        it cannot be made."""
        if folder.exists() or folder.is_symlink():
            raise RunExistsError(f"{folder} exists; nothing is overwritten; give another name")
        self._folder, self._stop = folder, stop
        self._trouble: OSError | None = None
        self._made: tuple[Path, ...] = ()
        self._lock = threading.Lock()  # the laser answers over two ports
        self._files: list[BinaryIO] = []
        try:
            self._made = make_folder(folder)
            self._files += [(folder / name).open("xb") for name in ("laser.logr", "wheels.candump")]
        except OSError as error:
            self._remove()
            raise StorageError(
                f"{folder} cannot be created ({error.strerror}); give another folder with --record"
            ) from error

    def laser(self, data: bytes) -> None:
        """One reply of the laser, which goes out now."""
        now_us = time.time_ns() // 1000
        self._write(0, RECORD.pack(now_us // 1_000_000, now_us % 1_000_000, len(data)) + data)

    def wheels(self, frame: CanFrame) -> None:
        """One frame of the wheels, which has gone out."""
        number = frame.arbitration_id | (ERROR_FLAG if frame.flags & ERROR else 0)
        digits = f"{number:08X}" if frame.flags & (ERROR | EXTENDED) else f"{number:03X}"
        data = "R" if frame.flags & REMOTE else frame.data.hex().upper()
        self._write(1, f"({time.time_ns() / 1e9:.6f}) can0 {digits}#{data}\n".encode())

    def _write(self, file: int, data: bytes) -> None:
        """In the thread of a device, which a full disk does not end."""
        with self._lock:
            if self._trouble is not None:
                return
            try:
                self._files[file].write(data)
            except OSError as error:
                self._trouble = error
                self._stop.set()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """Raises StorageError where not all could be written; then nothing is left."""
        try:
            for file in self._files:
                file.close()
        except OSError as error:
            self._trouble = self._trouble or error
        if self._trouble is None:
            return
        self._remove()
        why = f"{self._folder} cannot be written ({self._trouble.strerror}); what was recorded was removed"
        raise StorageError(f"{why}; give another folder with --record") from self._trouble

    def _remove(self) -> None:
        for file in self._files:
            with suppress(OSError):
                file.close()
            with suppress(OSError):
                Path(file.name).unlink()
        take_away(self._made)
