"""A zenoh router as ROS 2 starts it, in a process of its own, to be killed.

python -m tests.support.zenoh.router ENDPOINT
"""

import json
import subprocess
import sys
import time

import zenoh

from runtime.source_tree import ROOT


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


def start_router(endpoint: str) -> "subprocess.Popen[str]":
    router = subprocess.Popen(
        [sys.executable, "-m", "tests.support.zenoh.router", endpoint], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert router.stdout is not None
    assert router.stdout.readline() == "ready\n"
    return router


def stop_router(router: "subprocess.Popen[str]") -> None:
    router.kill()
    router.wait()
    assert router.stdout is not None
    router.stdout.close()


if __name__ == "__main__":
    route(sys.argv[1])
