"""A ROS 2 node without ROS, by zenoh-ros2-sdk: python -m tests.support.zenoh.ros2_node PORT TOPIC TYPE SECONDS.

Hears one topic through the router on that port, with the message definitions that a run.mcap carries, and prints one
JSON object of what the first message said. The type hash is computed by the kit out of the definitions.
"""

import json
import os
import re
import sys
import threading
from typing import Any

from zenoh_ros2_sdk import ROS2Subscriber
from zenoh_ros2_sdk.utils import compute_type_hash_from_msg

from runtime.messages.definitions import definition


def parted(type_name: str) -> tuple[str, dict[str, str]]:
    """The type's own definition, and those of all that it contains by full name."""
    own, *others = re.split(r"^=+\nMSG: (\S+)\n", definition(type_name), flags=re.MULTILINE)
    names = [f"{name.split('/')[0]}/msg/{name.split('/')[-1]}" for name in others[0::2]]
    return own, dict(zip(names, others[1::2], strict=True))


def kit_hash(type_name: str) -> str:
    """RIHS01 as the kit computes it, which does not ask the library that we write with."""
    own, contained = parted(type_name)
    text: str = compute_type_hash_from_msg(type_name, own, contained)
    return text


def hear(port: int, topic: str, type_name: str, seconds: float) -> dict[str, Any]:
    heard = threading.Event()
    messages: list[Any] = []

    def take(message: Any) -> None:
        messages.append(message)
        heard.set()

    ROS2Subscriber(
        topic, type_name, take, definition(type_name), domain_id=0, router_port=port, type_hash=kit_hash(type_name)
    )
    heard.wait(seconds)
    if not messages:
        return {}
    first = messages[0].transforms[0] if type_name.endswith("TFMessage") else messages[0]
    return {"frame": first.header.frame_id, "stamp_s": first.header.stamp.sec}


if __name__ == "__main__":
    sys.stdout.write(json.dumps(hear(int(sys.argv[1]), sys.argv[2], sys.argv[3], float(sys.argv[4]))) + "\n")
    sys.stdout.flush()
    os._exit(0)  # the kit's callbacks run on threads of Python that would keep the process alive
