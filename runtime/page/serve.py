"""infant page: the server in a process of its own, on the loopback unless another address of ours is named."""

import asyncio
import errno
import ipaddress
import socket
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from runtime.commands import Command
from runtime.errors import SensorError, UsageError
from runtime.optional_packages import needs
from runtime.printable import tell
from runtime.publish.commands import Answer, send_command
from runtime.publish.find_rover import find_rover

DEFAULT_PORT = 8448
QUEUE = 64  # connections that may wait to be accepted


@dataclass(frozen=True, slots=True)
class ServeOptions:
    """What the command was asked for. commands: whether the page gets buttons, which wants the loopback."""

    host: str = "127.0.0.1"
    port: int = DEFAULT_PORT
    connect: str | None = None
    rover: str | None = None
    config_file: str | None = None
    runs: Path = Path("runs")
    commands: bool = False


def serve_page(options: ServeOptions, stop: threading.Event, said: TextIO) -> dict[str, Any]:
    """Serve until `stop`; returns what was shown where.

    Raises UsageError, SensorError (port in use, address not ours, no rover), ConfigurationError.
    """
    with needs("starlette", "infant page"), needs("uvicorn", "infant page"):
        import uvicorn

        from runtime.page.connections import BoundedConnection, cut_client
        from runtime.page.hub import Hub
        from runtime.page.server import PageOptions, page_app
    if options.commands and not _is_loopback(options.host):
        raise UsageError(
            f"--commands with --host {options.host}: anyone who reaches the page could stop the recording; "
            "leave out --host and use ssh -L, or leave out --commands"
        )
    listening = bound_socket(options.host, options.port)
    rover = find_rover(options.connect, options.rover, options.config_file)

    def command(asked: Command, reason: str) -> Answer:
        return send_command(rover.endpoint, rover.name, asked, reason, options.config_file)

    port = listening.getsockname()[1]
    hosts = frozenset({options.host, "127.0.0.1", "localhost", "[::1]", f"[{options.host}]", socket.gethostname()})
    hub = Hub(rover, options.config_file)
    app = page_app(
        hub,
        PageOptions(
            hosts,
            options.runs,
            command if options.commands else None,
            end=lambda client: cut_client(server.server_state.connections, client),
        ),
    )
    server = uvicorn.Server(
        uvicorn.Config(
            app,
            http=BoundedConnection,
            log_level="error",
            access_log=False,
            server_header=False,
            ws="none",
            lifespan="off",
            timeout_keep_alive=5,
            timeout_graceful_shutdown=1,
            backlog=QUEUE,
            h11_max_incomplete_event_size=16 << 10,
        )
    )
    hub.is_ending = lambda: server.should_exit
    hub.start()
    threading.Thread(target=_end_with, args=(stop, server), daemon=True).start()
    url = f"http://{_in_url(options.host)}:{port}/"
    tell(said, f"infant: {rover.name} is served at {url}\n")
    try:
        with listening:
            asyncio.run(server.serve(sockets=[listening]))
    finally:
        hub.close()
    return {"rover": rover.name, "url": url}


def bound_socket(host: str, port: int) -> socket.socket:
    """A socket that is bound and does not listen yet. Raises SensorError with a sentence where it cannot be had."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        made = socket.socket(family, kind, protocol)
    except (OSError, UnicodeError) as error:
        raise SensorError(f"--host {host!r} is not an address ({error}); give one of this machine") from error
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(address)
    except (OSError, OverflowError) as error:
        made.close()
        code = error.errno if isinstance(error, OSError) else None
        if code == errno.EADDRINUSE:
            raise SensorError(f"port {port} is in use at {host}; give another with --port") from error
        if code == errno.EADDRNOTAVAIL:
            raise SensorError(f"{host} is not an address of this machine; ip address shows them") from error
        raise SensorError(f"{host}:{port} cannot be used ({error}); give another --host or --port") from error
    return made


def _end_with(stop: threading.Event, server: Any) -> None:
    stop.wait()
    server.should_exit = True


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _in_url(host: str) -> str:
    return f"[{host}]" if ":" in host else host
