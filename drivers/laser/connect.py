"""From a URL to an open link with a quiet laser at its end; over a serial line at whatever rate it answers."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from drivers.events import EventLog
from drivers.laser.client import ScipClient
from drivers.laser.handshake import REPLY_TIMEOUT_S, LaserFaultError, NoAnswerError, NotScipError, enter_standby
from drivers.laser.link import ByteLink, SerialLink, TcpLink
from drivers.measurements import DriverError, LinkError, RawTap
from drivers.scip.codec import OK
from drivers.settings.laser import BAUDS, LaserSettings, SerialEndpoint, endpoint

CONNECT_TIMEOUT_S = 1.0  # s until a connection counts as refused
REBOOT_INTERVAL_S = 5.0  # s between reboots at least; booting takes 2 s


@dataclass(frozen=True, slots=True)
class Connection:
    """An open link and the conversation over it."""

    link: ByteLink
    client: ScipClient


class LaserConnector:
    """Opens links; remembers the baud rate that worked and when the laser was rebooted."""

    def __init__(
        self,
        settings: LaserSettings,
        tap: RawTap | None,
        now_ns: Callable[[], int],
        is_closing: Callable[[], bool],
        events: EventLog,
    ) -> None:
        self._settings = settings
        self._endpoint = endpoint(settings.url)
        self._tap = tap
        self._now_ns = now_ns
        self._is_closing = is_closing
        self._events = events
        self._baud: int | None = None
        self._rebooted_ns: int | None = None

    def connect(self) -> Connection:
        """An open link to a laser in standby. Raises DriverError; the link is closed then."""
        if not isinstance(self._endpoint, SerialEndpoint):
            return self._client_in_standby(TcpLink(self._endpoint, CONNECT_TIMEOUT_S), attempts=3)
        wanted, failure = self._endpoint, None
        for baud in self._rates(wanted):
            try:
                connection = self._client_in_standby(SerialLink(wanted, baud), attempts=1)
            except (NoAnswerError, NotScipError) as error:
                failure = error
                continue
            self._baud = baud
            if wanted.baud is None or wanted.baud == baud:
                return connection
            return self._at_rate(connection, wanted, wanted.baud)
        assert failure is not None
        raise failure

    def reboot(self, client: ScipClient) -> None:
        """RB twice; only sometimes, because a laser that boots says nothing for seconds."""
        now_ns = self._now_ns()
        interval_ns = REBOOT_INTERVAL_S * 1e9
        is_recent = self._rebooted_ns is not None and now_ns - self._rebooted_ns < interval_ns
        if is_recent or not self._settings.reboot_on_fault:
            return
        self._rebooted_ns = now_ns
        self._events.add(now_ns, "reboots", "the laser reported a malfunction and is rebooted")
        try:
            for _ in range(2):
                client.ask(b"RB", REPLY_TIMEOUT_S)
        except LinkError:
            return  # it went down before it had answered, which is what was asked

    def _at_rate(self, connection: Connection, wanted: SerialEndpoint, baud: int) -> Connection:
        """The same laser at the configured rate, or as it is if it refuses that."""
        try:
            reply = connection.client.ask(b"SS%06d" % baud, REPLY_TIMEOUT_S)
        except LinkError:
            connection.link.close()
            raise
        if reply is not None and reply.status not in (OK, "03"):
            text = f"the laser refuses {baud} baud (status {reply.status}) and runs at {self._baud}; change laser.url"
            self._events.add(self._now_ns(), "baud_refused", text)
            return connection
        connection.link.close()
        self._baud = baud
        return self._client_in_standby(SerialLink(wanted, baud), attempts=3)

    def _client_in_standby(self, link: ByteLink, attempts: int) -> Connection:
        client = ScipClient(link, self._tap, self._now_ns, self._is_closing)
        try:
            enter_standby(client, self._settings, attempts)
        except DriverError as error:
            if isinstance(error, LaserFaultError):
                self.reboot(client)
            link.close()
            raise
        return Connection(link, client)

    def _rates(self, wanted: SerialEndpoint) -> Iterator[int]:
        """Baud rates in the order in which the laser is likely to answer."""
        first = [rate for rate in (self._baud, wanted.baud) if rate is not None]
        yield from dict.fromkeys([*first, *BAUDS])
