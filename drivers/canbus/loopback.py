"""python-can's udp_multicast bus, held to the loopback interface: needs no network and leaves no trace on one.

python-can joins its group on whatever interface has the route, and fails where there is none (a rover on a bench,
a laptop in the train).
"""

import socket
import struct

import can
from can.interfaces.udp_multicast.bus import SO_TIMESTAMPNS, GeneralPurposeUdpMulticastBus, UdpMulticastBus

LOOPBACK = "127.0.0.1"


class LoopbackSocket(GeneralPurposeUdpMulticastBus):
    """The same frames in the same packing; only the socket is made here."""

    def _create_socket(self, address_family: socket.AddressFamily) -> socket.socket:
        sock = socket.socket(address_family, socket.SOCK_DGRAM)
        try:
            for option in (socket.SO_REUSEADDR, socket.SO_REUSEPORT):
                sock.setsockopt(socket.SOL_SOCKET, option, 1)
            sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
            self.timestamp_nanosecond = True
            interface = socket.inet_aton(LOOPBACK)
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, struct.pack("@I", 0))
            sock.bind((self.group, self.port))
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(self.group) + interface)
        except OSError as error:
            sock.close()
            text = f"multicast group {self.group} on {LOOPBACK}: {error.strerror}"
            raise can.CanInitializationError(text, error.errno) from error
        return sock


class LoopbackBus(UdpMulticastBus):
    """UdpMulticastBus of one machine; other processes on it may use python-can's own with hop_limit 0."""

    def __init__(self, channel: str, port: int, can_filters: can.typechecking.CanFilters | None = None) -> None:
        can.BusABC.__init__(self, channel, can_filters)
        self._multicast = LoopbackSocket(channel, port, 0)
        self._can_protocol = can.CanProtocol.CAN_FD


def free_port() -> int:
    """A UDP port that nothing on this machine listens to."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])
