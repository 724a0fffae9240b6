"""Messages to the service manager: one datagram each (sd_notify(3)), nothing where there is no manager."""

import os
import socket
from typing import TextIO

from runtime.printable import printable, tell

LONGEST = 1000  # characters of a status
STOP_US = 80_000_000  # TimeoutStopSec of the unit: a minute for the review, some seconds for sensors and record


class ServiceManager:
    """Sends to $NOTIFY_SOCKET, whose value the command line passes in; empty means there is none.

    Nothing here blocks or raises: the socket does not wait, and a manager that is gone is the manager's trouble.
    """

    def __init__(self, address: str) -> None:
        self._socket: socket.socket | None = None
        if address:
            self._address = "\0" + address[1:] if address.startswith("@") else address
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)

    def ready(self) -> None:
        """The runtime is alive and the first tick follows; sensors may still be on their way."""
        self._send(f"READY=1\nMAINPID={os.getpid()}")

    def completed_tick(self) -> None:
        """Feed the watchdog; called by the loop only, after a tick has ended."""
        self._send("WATCHDOG=1")

    def status(self, text: str) -> None:
        """The line that `systemctl status` shows."""
        self._send(f"STATUS={printable(text, LONGEST)}")  # a line of its own would be another message to the manager

    def stopping(self) -> None:
        """The shutdown has begun: no tick feeds the watchdog any more, which would end us before all is written."""
        self._send(f"STOPPING=1\nWATCHDOG_USEC={STOP_US}")

    def close(self) -> None:
        """Release the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, message: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(message.encode(), self._address)
        except OSError:
            return  # no one listens: there is nothing to tell it to


class WatchdogFeed:
    """The only one who feeds the watchdog: the loop's thread, after a tick, and while no other thread hangs."""

    def __init__(self, manager: ServiceManager, stream: TextIO) -> None:
        self._manager = manager
        self._stream = stream
        self._reported = ""

    def completed_tick(self, stuck: str) -> None:
        """A tick has ended; stuck: the threads that hang, as ThreadWatch names them, "" if none does."""
        if not stuck:
            self._manager.completed_tick()
            self._reported = ""
        elif not self._reported:
            self._reported = stuck
            tell(self._stream, f"infant: {stuck}; the watchdog is no longer fed and will restart the service\n")
