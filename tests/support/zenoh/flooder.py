"""Asks and puts more than any rover takes: python -m tests.support.zenoh.flooder ENDPOINT MEGABYTES SECONDS."""

import sys
import time
from contextlib import suppress

import zenoh

from runtime.publish.session import tool_config


def flood(endpoint: str, megabytes: int, seconds: float) -> None:
    payload = bytes(megabytes << 20)
    with zenoh.open(tool_config(endpoint)) as session:
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        deadline_s = time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            with suppress(zenoh.ZError):
                list(session.get("infant/*/status", payload=payload, timeout=0.5))
                session.put("infant/r1/pose", payload, congestion_control=zenoh.CongestionControl.BLOCK)


if __name__ == "__main__":
    flood(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]))
