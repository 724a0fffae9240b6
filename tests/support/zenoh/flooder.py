"""Asks and puts more than any rover takes: python -m tests.support.zenoh.flooder ENDPOINT ROVER BYTES SECONDS [FILE].

FILE: a zenoh configuration with certificates. Prints at its end how often it asked and put as one JSON object.
"""

import json
import sys
import time

import zenoh

from runtime.publish.session import tool_config


def flood(endpoint: str, rover: str, size: int, seconds: float, file: str | None) -> None:
    payload = bytes(size)
    done = {"asked": 0, "put": 0, "refused": 0}
    with zenoh.open(tool_config(endpoint, file)) as session:
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        deadline_s = time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            try:
                session.get("infant/*/status", handler=zenoh.handlers.RingChannel(1), payload=payload, timeout=0.5)
                done["asked"] += 1
                session.put(f"infant/{rover}/pose", payload, congestion_control=zenoh.CongestionControl.BLOCK)
                done["put"] += 1
            except zenoh.ZError:
                done["refused"] += 1
                time.sleep(0.01)
        sys.stdout.write(json.dumps(done) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    flood(sys.argv[1], sys.argv[2], int(sys.argv[3]), float(sys.argv[4]), sys.argv[5] if sys.argv[5:] else None)
