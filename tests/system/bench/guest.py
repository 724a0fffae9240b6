"""What every program in the guest needs: modules, a shell, a way to report, and frames that no driver would send."""

import ctypes
import json
import os
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

MODULES = (
    "net/can/can.ko",
    "net/can/can-raw.ko",
    "drivers/net/can/dev/can-dev.ko",
    "drivers/net/can/vcan.ko",
    "drivers/net/can/slcan/slcan.ko",
)
FINIT_MODULE = 313  # x86-64
ALREADY_LOADED = 17
BURST_FRAMES = 3000
FOREIGN_ID = 0x321  # of no wheel


def shell(command: str) -> None:
    """Raises CalledProcessError."""
    subprocess.run(command, shell=True, check=True)


def report(name: str, **values: Any) -> None:
    """One result for the host."""
    sys.stdout.write("RESULT " + json.dumps({"name": name, **values}) + "\n")
    sys.stdout.flush()


def load_modules(root: Path) -> None:
    """finit_module by hand: the host may have no kmod."""
    kernel = next((root / "usr" / "lib" / "uml" / "modules").iterdir()) / "kernel"
    libc = ctypes.CDLL(None, use_errno=True)
    for name in MODULES:
        descriptor = os.open(kernel / name, os.O_RDONLY)
        if libc.syscall(FINIT_MODULE, descriptor, b"", 0) and ctypes.get_errno() != ALREADY_LOADED:
            raise OSError(ctypes.get_errno(), f"module {name}")
        os.close(descriptor)


def inject_error(error_class: int, data: bytes) -> None:
    """An error frame as a controller's driver would report it."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
        raw.bind(("vcan0",))
        raw.send(struct.pack("=IB3x8s", 0x20000000 | error_class, 8, data))


def burst(number: int = FOREIGN_ID, count: int = BURST_FRAMES) -> None:
    """Frames of one id as fast as the bus takes them; their bytes are a running number, so no checksum fits."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
        raw.bind(("vcan0",))
        for value in range(count):
            while True:
                try:
                    raw.send(struct.pack("=IB3x8s", number, 8, value.to_bytes(8, "little")))
                    break
                except OSError:
                    time.sleep(0.001)
