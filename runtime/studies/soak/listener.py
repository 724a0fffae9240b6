"""Another program that listens to everything the rover says: `python -m runtime.studies.soak.listener ENDPOINT`.

Counts messages by key until standard input ends, then prints them as one JSON object.
"""

import json
import select
import subprocess
import sys
from collections import Counter
from contextlib import suppress

import zenoh

from runtime.publish.session import tool_config

START_S = STOP_S = 15.0


class Listener:
    """The program, as the one who starts it sees it."""

    def __init__(self, endpoint: str) -> None:
        self._child = subprocess.Popen(
            [sys.executable, "-m", "runtime.studies.soak.listener", endpoint],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for the parent
        )

    def await_subscribed(self) -> None:
        """Wait until it listens, at most 15 s: what comes late would look like a descriptor that leaked."""
        assert self._child.stdout is not None
        if select.select([self._child.stdout], [], [], START_S)[0]:
            self._child.stdout.readline()

    def heard(self) -> dict[str, int]:
        """End it; messages by key, {} where it did not end well."""
        try:
            said, _ = self._child.communicate(timeout=STOP_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.communicate()
            return {}
        lines = said.splitlines()
        counted: dict[str, int] = json.loads(lines[-1]) if lines and lines[-1].startswith("{") else {}
        return counted


def listen(endpoint: str) -> None:
    """Subscribe to everything and count until standard input ends."""
    config = tool_config(endpoint)
    config.insert_json5("connect/timeout_ms", "-1")  # wait for the rover to come up
    heard: Counter[str] = Counter()

    def count(sample: zenoh.Sample) -> None:
        heard[str(sample.key_expr)] += 1

    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber("infant/**", count)
        sys.stdout.write("listening\n")
        sys.stdout.flush()
        sys.stdin.read()
        subscriber.undeclare()  # type: ignore[no-untyped-call]
    with suppress(BrokenPipeError):  # whoever asked is gone
        sys.stdout.write(json.dumps(heard) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    listen(sys.argv[1])
