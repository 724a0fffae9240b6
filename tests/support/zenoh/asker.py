"""A process that never stops asking a rover: python -m tests.support.zenoh.asker ENDPOINT KEY SECONDS."""

import sys
import time

import zenoh

from runtime.publish.session import tool_config


def ask(endpoint: str, key: str, seconds: float) -> None:
    with zenoh.open(tool_config(endpoint)) as session:
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        deadline_s = time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            for _ in range(50):  # many at a time: some are being answered whenever the rover leaves
                session.get(key, handler=zenoh.handlers.FifoChannel(10), timeout=0.2)
            time.sleep(0.001)


if __name__ == "__main__":
    ask(sys.argv[1], sys.argv[2], float(sys.argv[3]))
