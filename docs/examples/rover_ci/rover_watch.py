"""A program of yours that reads the laser: it asks a SCIP sensor for its model over TCP."""

import socket
from urllib.parse import urlsplit


def model_of(url: str, timeout_s: float) -> str | None:
    """The model of the laser at tcp://HOST:PORT, None where it does not answer in time."""
    parts = urlsplit(url)
    with socket.create_connection((parts.hostname or "", parts.port or 10940), timeout_s) as link:
        link.sendall(b"PP\n")
        answer = b""
        while not answer.endswith(b"\n\n"):
            try:
                answer += link.recv(4096)
            except TimeoutError:
                return None
    lines = answer.decode("ascii").splitlines()
    return next(line.split(":")[1].split(";")[0] for line in lines if line.startswith("MODL:"))
