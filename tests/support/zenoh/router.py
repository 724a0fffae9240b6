"""A zenoh router as ROS 2 starts it, in a process of its own, to be killed.

python -m tests.support.zenoh.router ENDPOINT
"""

import json
import sys
import time

import zenoh


def route(endpoint: str) -> None:
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "true")
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    with zenoh.open(config):
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        while True:
            time.sleep(1.0)


if __name__ == "__main__":
    route(sys.argv[1])
