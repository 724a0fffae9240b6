import os
import pty
import socket
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.laser.link import SerialLink, TcpLink, permission_advice
from drivers.measurements import LinkError
from drivers.settings.laser import SerialEndpoint, TcpEndpoint


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    """Master descriptor and path of a pseudo-terminal."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    for descriptor in (master, slave):
        try:
            os.close(descriptor)
        except OSError:
            continue  # the test has closed it


def connected() -> tuple[TcpLink, socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = TcpLink(TcpEndpoint(host="127.0.0.1", port=server.getsockname()[1]), 1.0)
        peer, _ = server.accept()
    return link, peer


def test_bytes_go_both_ways_over_tcp_without_waiting_to_be_collected() -> None:
    link, peer = connected()
    with peer:
        link.write(b"QT\n")
        assert peer.recv(16) == b"QT\n"
        peer.sendall(b"QT\n00P\n\n")
        assert link.read(1.0) == b"QT\n00P\n\n"
        assert link.read(0.01) == b""
        assert link._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 1
    with pytest.raises(LinkError, match="closed the connection"):
        link.read(1.0)
    link.close()


def test_a_connection_that_was_reset_is_named() -> None:
    link, peer = connected()
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    peer.close()
    with pytest.raises(LinkError, match="broke"):
        link.read(1.0)
    link.close()


@pytest.mark.parametrize(
    ("host", "port", "sentence"),
    [("127.0.0.1", 1, "nothing listens at 127.0.0.1:1"), ("no.such.host.invalid", 1, "check the host in laser.url")],
)
def test_a_laser_that_cannot_be_reached_is_one_sentence_with_advice(host: str, port: int, sentence: str) -> None:
    with pytest.raises(LinkError, match=sentence) as caught:
        TcpLink(TcpEndpoint(host=host, port=port), 0.2)
    assert "\n" not in str(caught.value)


def test_bytes_go_both_ways_over_a_serial_port(terminal: tuple[int, str]) -> None:
    master, path = terminal
    link = SerialLink(SerialEndpoint(path=path, baud=None), 115200)
    link.write(b"QT\n")
    assert os.read(master, 16) == b"QT\n"
    os.write(master, bytes(range(256)))
    received = b""
    while len(received) < 256:
        received += link.read(1.0)
    assert received == bytes(range(256))  # nothing is taken for a control character
    assert link.read(0.01) == b""
    link.close()


def test_a_pulled_cable_is_named(terminal: tuple[int, str]) -> None:
    master, path = terminal
    link = SerialLink(SerialEndpoint(path=path, baud=None), 115200)
    os.close(master)
    with pytest.raises(LinkError, match=r"broke|hung up"):
        link.read(1.0)
    with pytest.raises(LinkError):
        link.write(b"QT\n")
    link.close()


def test_a_port_in_use_is_named(terminal: tuple[int, str]) -> None:
    _, path = terminal
    first = SerialLink(SerialEndpoint(path=path, baud=None), 115200)
    with pytest.raises(LinkError, match="in use by another program"):
        SerialLink(SerialEndpoint(path=path, baud=None), 115200)
    first.close()
    SerialLink(SerialEndpoint(path=path, baud=None), 115200).close()


def test_a_device_file_that_is_absent_or_no_serial_port_is_named(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="does not exist"):
        SerialLink(SerialEndpoint(path=str(tmp_path / "laser"), baud=None), 115200)
    (tmp_path / "file").touch()
    with pytest.raises(LinkError, match="check that it is a serial port"):
        SerialLink(SerialEndpoint(path=str(tmp_path / "file"), baud=None), 115200)


def test_missing_permission_names_the_group_that_has_it(tmp_path: Path) -> None:
    path = tmp_path / "laser"
    path.touch()
    path.chmod(0o660)
    assert f"add this user to the group {path.group()}" in permission_advice(str(path))
    path.chmod(0o600)
    assert "udev rule" in permission_advice(str(path))
