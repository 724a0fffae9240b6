"""Keys, attachments and liveliness tokens by which rmw_zenoh, the zenoh transport of ROS 2, finds a publisher.

Source: ros2/rmw_zenoh, docs/design.md and rmw_zenoh_cpp/src/detail/liveliness_utils.cpp (rolling).
"""

import re
import struct

import xxhash

from runtime.messages.definitions import type_store

QOS_DEFAULT = "::,10:,:,:,,"  # reliable, volatile, keep the last 10, no deadline, lifespan or lease: all as default
QOS_LATCHED = ":1:,1:,:,:,,"  # transient local, keep the last
NODE = "infant"
HUMBLE_HASH = "TypeHashNotSupported"


def ros_name(rover: str) -> str:
    """The rover's name as a ROS namespace, which knows no hyphen and no leading digit."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", rover)
    return f"rover_{name}" if name[0].isdigit() else name


def dds_type(type_name: str) -> str:
    """geometry_msgs/msg/Pose becomes geometry_msgs::msg::dds_::Pose_."""
    package, _, name = type_name.split("/")
    return f"{package}::msg::dds_::{name}_"


def type_hash(type_name: str) -> str:
    """RIHS01_ and the hash of the type's description (REP 2011)."""
    text: str = type_store().hash_rihs01(type_name)
    return text if text.startswith("RIHS01_") else f"RIHS01_{text}"


def wire_type(type_name: str, humble: bool = False) -> str:
    """Type and its hash, in keys and tokens; Humble, which knows no hash, has a constant there."""
    return f"{dds_type(type_name)}/{HUMBLE_HASH if humble else type_hash(type_name)}"


def data_key(domain: int, topic: str, type_name: str, humble: bool = False) -> str:
    """Key of the messages of a topic such as /infant/pose."""
    return f"{domain}/{topic.lstrip('/')}/{wire_type(type_name, humble)}"


def node_token(domain: int, zid: str, namespace: str) -> str:
    """Liveliness key that makes `ros2 node list` show us; entity 0 is the node."""
    return f"@ros2_lv/{domain}/{zid}/0/0/NN/%/%{namespace}/{NODE}"


def publisher_token(
    domain: int,
    zid: str,
    namespace: str,
    entity: int,
    topic: str,
    type_name: str,
    humble: bool = False,
    qos: str = QOS_DEFAULT,
) -> str:
    """Liveliness key of one publisher of that node; slashes of names become percent signs."""
    mangled = topic.replace("/", "%")
    return f"@ros2_lv/{domain}/{zid}/0/{entity}/MP/%/%{namespace}/{NODE}/{mangled}/{wire_type(type_name, humble)}/{qos}"


def publisher_gid(token: str) -> bytes:
    """Sixteen bytes that name a publisher, as rmw_zenoh makes them of its liveliness key: XXH3, 128 bits, seed 0."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


def attachment(seq: int, stamp_ns: int, gid: bytes) -> bytes:
    """33 bytes: sequence number, wall time in ns, length of the gid, gid (16). All our keys carry it.

    A rmw_zenoh that cannot read the attachment of a message ends its process: the form must be exact.
    """
    return struct.pack("<qqB16s", seq, stamp_ns, 16, gid)
