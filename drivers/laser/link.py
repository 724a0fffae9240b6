"""Byte links to a sensor: TCP and serial. Reads wait in the kernel, so that other threads have the interpreter."""

import grp
import os
import select
import socket
import stat
from typing import Protocol

import serial

from drivers.measurements import LinkError
from drivers.settings.laser import SerialEndpoint, TcpEndpoint

CHUNK_BYTES = 1 << 16
WRITE_TIMEOUT_S = 1.0


class ByteLink(Protocol):
    """An open link; used by one thread."""

    def read(self, timeout_s: float) -> bytes:
        """What has arrived, at most 64 kB; b"" after timeout_s of silence. Raises LinkError when the link is gone."""

    def write(self, data: bytes) -> None:
        """Send all of it. Raises LinkError."""

    def close(self) -> None:
        """Release it; never fails."""


class TcpLink:
    """A connection to a laser with Ethernet. Raises LinkError, one sentence, when it cannot be made."""

    def __init__(self, endpoint: TcpEndpoint, timeout_s: float) -> None:
        self._name = f"{endpoint.host}:{endpoint.port}"
        try:
            self._socket = socket.create_connection((endpoint.host, endpoint.port), timeout_s)
        except socket.gaierror as error:
            raise LinkError(
                f"laser host {endpoint.host!r} has no address ({error.strerror}); check the host in laser.url"
            ) from error
        except ConnectionRefusedError as error:
            raise LinkError(
                f"nothing listens at {self._name}; check the port in laser.url and that the laser has started"
            ) from error
        except OSError as error:
            reason = error.strerror or f"no answer within {timeout_s:g} s"
            raise LinkError(
                f"laser at {self._name} cannot be reached ({reason}); check cable, power and the address in laser.url"
            ) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def read(self, timeout_s: float) -> bytes:
        """See ByteLink."""
        try:
            self._socket.settimeout(timeout_s)
            data = self._socket.recv(CHUNK_BYTES)
        except TimeoutError:
            return b""
        except OSError as error:
            raise LinkError(f"the connection to {self._name} broke ({error.strerror})") from error
        if not data:
            raise LinkError(f"the laser at {self._name} closed the connection")
        return data

    def write(self, data: bytes) -> None:
        """See ByteLink."""
        try:
            self._socket.settimeout(WRITE_TIMEOUT_S)
            self._socket.sendall(data)
        except OSError as error:
            raise LinkError(f"the connection to {self._name} accepts no data ({error.strerror or error})") from error

    def close(self) -> None:
        """See ByteLink."""
        self._socket.close()


class SerialLink:
    """A serial port (RS-232, USB-ACM or a pseudo-terminal), raw, 8N1. Raises LinkError when it cannot be opened."""

    def __init__(self, endpoint: SerialEndpoint, baud: int) -> None:
        self._path = endpoint.path
        if not os.path.exists(endpoint.path):
            raise LinkError(f"device file {endpoint.path} does not exist; check the cable and laser.url")
        if not os.access(endpoint.path, os.R_OK | os.W_OK):
            raise LinkError(permission_advice(endpoint.path))
        try:
            self._port = serial.Serial(endpoint.path, baud, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise LinkError(_refusal(endpoint.path, baud, error)) from error
        self._poll = select.poll()
        self._poll.register(self._port.fileno(), select.POLLIN)

    def read(self, timeout_s: float) -> bytes:
        """See ByteLink."""
        try:
            if not self._poll.poll(timeout_s * 1000.0):
                return b""
            data = os.read(self._port.fileno(), CHUNK_BYTES)
        except BlockingIOError:
            return b""
        except (OSError, serial.SerialException) as error:
            raise LinkError(f"device file {self._path} failed ({error})") from error
        if not data:
            raise LinkError(f"device file {self._path} hung up; was the cable pulled?")
        return data

    def write(self, data: bytes) -> None:
        """See ByteLink."""
        try:
            self._port.write(data)
        except (OSError, serial.SerialException) as error:
            raise LinkError(f"device file {self._path} accepts no data ({error})") from error

    def close(self) -> None:
        """See ByteLink."""
        try:
            self._port.close()
        except OSError:
            return  # a device that was pulled out cannot be closed in order; the descriptor is gone all the same


def permission_advice(path: str) -> str:
    """Which group may use the device file."""
    status = os.stat(path)
    try:
        group = grp.getgrgid(status.st_gid).gr_name
    except KeyError:
        group = str(status.st_gid)
    if status.st_mode & stat.S_IWGRP and status.st_mode & stat.S_IRGRP:
        return f"no permission on {path}; add this user to the group {group} and log in again"
    return f"no permission on {path}, and its group {group} has none either; install the udev rule for the laser"


def _refusal(path: str, baud: int, error: Exception) -> str:
    if getattr(error, "errno", None) in (11, 16):  # EAGAIN from the lock, EBUSY
        return f"{path} is in use by another program; stop that program"
    return f"{path} cannot be opened at {baud} baud ({error}); check that it is a serial port and the baud in laser.url"
