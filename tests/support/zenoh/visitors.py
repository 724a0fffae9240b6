"""Subscribers that come and go: python -m tests.support.zenoh.visitors ENDPOINT COUNT SECONDS.

Each is a session of its own that subscribes to everything, hears one message and leaves. Prints one JSON object:
how many came, how many heard something within these seconds, and the longest time from opening to the first message.
"""

import json
import sys
import time

import zenoh

from runtime.publish.session import tool_config


def visit(endpoint: str, within_s: float) -> float | None:
    """Seconds from the start of connecting to the first message, None if none came in time."""
    began_s = time.monotonic()
    with zenoh.open(tool_config(endpoint)) as session:
        subscriber = session.declare_subscriber("infant/**", zenoh.handlers.FifoChannel(10))
        while time.monotonic() < began_s + within_s:
            if subscriber.try_recv() is not None:
                return time.monotonic() - began_s
            time.sleep(0.001)
    return None


if __name__ == "__main__":
    waits_s = [visit(sys.argv[1], float(sys.argv[3])) for _ in range(int(sys.argv[2]))]
    heard_s = [wait_s for wait_s in waits_s if wait_s is not None]
    sys.stdout.write(json.dumps({"came": len(waits_s), "heard": len(heard_s), "longest_s": max(heard_s, default=0.0)}))
