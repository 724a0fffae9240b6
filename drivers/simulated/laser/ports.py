"""Where the simulated laser can be reached: one TCP client at a time, and a pseudo-terminal."""

import errno
import os
import pty
import re
import socket
import struct
import termios
import tty
from collections.abc import Callable
from pathlib import Path

from drivers.measurements import LinkError

COMMAND_BYTES = 1024  # a longer line without its end is no command
UNSENT_BYTES = 1 << 17  # scans are dropped for a client that does not read
LINE_END = re.compile(rb"[\r\n]")
RATES = {getattr(termios, f"B{rate}"): rate for rate in (9600, 19200, 38400, 57600, 115200, 500000)}


class Wire:
    """A descriptor to one client: commands in, replies out, never waiting. tap: gets what is sent."""

    def __init__(self, descriptor: int, release: Callable[[], None]) -> None:
        os.set_blocking(descriptor, False)
        self.descriptor = descriptor
        self._release = release
        self.tap: Callable[[bytes], None] | None = None
        self._received = b""
        self._unsent = b""

    @property
    def has_unsent(self) -> bool:
        """True while the client has not taken everything."""
        return bool(self._unsent)

    def commands(self) -> list[bytes] | None:
        """Commands that have arrived, without their line ends; None when the client has gone."""
        try:
            data = os.read(self.descriptor, 4096)
        except BlockingIOError:
            return []
        except OSError:
            return None
        if not data:
            return None
        *lines, self._received = LINE_END.split(self._received + data)
        self._received = self._received[-COMMAND_BYTES:]
        return lines

    def send(self, data: bytes) -> None:
        """Queue and send; dropped as a whole if the client is too far behind."""
        if len(self._unsent) < UNSENT_BYTES:
            if self.tap is not None:
                self.tap(data)
            self._unsent += data
            self.flush()

    def flush(self) -> None:
        """Send what the kernel takes."""
        try:
            while self._unsent:
                self._unsent = self._unsent[os.write(self.descriptor, self._unsent) :]
        except BlockingIOError:
            return
        except OSError:
            self._unsent = b""  # the client has gone; the next read says so

    def close(self) -> None:
        """Hang up."""
        self._release()


class TcpPort:
    """Listens for one client at a time; a second one is turned away while the first is there."""

    def __init__(self, host: str, port: int) -> None:
        self._address = (host, port)
        self.listener: socket.socket | None = None
        self.wire: Wire | None = None
        self._client: socket.socket | None = None

    @property
    def url(self) -> str:
        """Endpoint as the driver's configuration writes it."""
        return f"tcp://{self._address[0]}:{self._address[1]}"

    def open(self) -> None:
        """Begin to listen; the port stays the same from the first time on. Raises LinkError."""
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(self._address)
        except OSError as error:
            listener.close()
            raise LinkError(f"cannot listen at {self.url} ({error.strerror}); choose another address") from error
        listener.listen(4)
        listener.setblocking(False)
        self._address = listener.getsockname()[:2]
        self.listener = listener

    def accept(self) -> Wire | None:
        """The new client; None if there is one already or it has gone again."""
        assert self.listener is not None
        try:
            client, _ = self.listener.accept()
        except OSError:
            return None
        if self.wire is not None:
            client.close()
            return None
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client, self.wire = client, Wire(client.fileno(), client.close)
        return self.wire

    def hang_up(self, reset: bool = False) -> None:
        """Let go of the client; reset: without a farewell, as when a cable is cut."""
        if self.wire is not None and self._client is not None:
            if reset:
                self._client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            self.wire.close()
        self.wire = self._client = None

    def close(self, reset: bool = False) -> None:
        """Stop listening."""
        self.hang_up(reset)
        if self.listener is not None:
            self.listener.close()
            self.listener = None


class PtyPort:
    """A pseudo-terminal behind a link of a chosen name; it disappears with the cable."""

    def __init__(self, path: str) -> None:
        self._path = Path(path)
        self._descriptors: tuple[int, int] | None = None
        self.wire: Wire | None = None

    @property
    def url(self) -> str:
        """Endpoint as the driver's configuration writes it."""
        return f"serial://{self._path.absolute()}"

    @property
    def baud(self) -> int | None:
        """Rate that the client has set; None for one that termios does not name."""
        assert self._descriptors is not None
        return RATES.get(termios.tcgetattr(self._descriptors[0])[4])

    def open(self) -> Wire:
        """Make the terminal and the link. Raises LinkError if the name is taken by something else."""
        if self._path.exists() and not self._path.is_symlink():
            raise LinkError(f"{self._path} exists and is not a link; choose another path for the pseudo-terminal")
        master, slave = pty.openpty()
        tty.setraw(slave)
        self._path.unlink(missing_ok=True)
        self._path.symlink_to(os.ttyname(slave))
        # the slave stays open here: without it the master reports a hang-up until a client comes
        self._descriptors = (master, slave)
        self.wire = Wire(master, self._release)
        return self.wire

    def close(self) -> None:
        """Take it away; a client then sees its device hang up."""
        if self.wire is not None:
            self.wire.close()
            self.wire = None
            self._path.unlink(missing_ok=True)

    def _release(self) -> None:
        if self._descriptors is not None:
            for descriptor in self._descriptors:
                try:
                    os.close(descriptor)
                except OSError as error:
                    if error.errno != errno.EIO:
                        raise
            self._descriptors = None
