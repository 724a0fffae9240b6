"""A subscriber in a process of its own: python -m tests.support.zenoh.listener ENDPOINT KEY SECONDS.

Prints "ready" once it is connected and subscribed, then one JSON object per message.
"""

import json
import sys
import time

import zenoh

from runtime.publish.session import tool_config


def say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def listen(endpoint: str, key: str, seconds: float) -> None:
    config = tool_config(endpoint)
    config.insert_json5("connect/timeout_ms", "-1")  # wait for the rover to come up
    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber(key, zenoh.handlers.FifoChannel(1000))
        deadline_s = time.monotonic() + seconds
        say("ready")
        while time.monotonic() < deadline_s:
            sample = subscriber.try_recv()
            if sample is None:
                time.sleep(0.001)
                continue
            message = {
                "key": str(sample.key_expr),
                "encoding": str(sample.encoding),
                "payload": sample.payload.to_bytes().hex(),
                "attachment": sample.attachment.to_bytes().hex() if sample.attachment else "",
                "arrived_ns": time.monotonic_ns(),
            }
            say(json.dumps(message))


if __name__ == "__main__":
    listen(sys.argv[1], sys.argv[2], float(sys.argv[3]))
