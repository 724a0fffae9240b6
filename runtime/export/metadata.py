"""metadata.yaml of a rosbag2 folder, version 9 as Jazzy and Kilted write it, and what topics offer."""

from collections.abc import Mapping
from dataclasses import dataclass

from runtime.publish.ros2_keys import type_hash

VERSION = 9
KEEP_LAST, RELIABLE, BEST_EFFORT, TRANSIENT_LOCAL, VOLATILE = 1, 1, 2, 1, 2  # rmw_qos_*_policy_t


@dataclass(frozen=True, slots=True)
class Qos:
    """A QoS profile."""

    depth: int
    reliability: int
    durability: int

    @property
    def as_text(self) -> str:
        """As YAML, which is how rosbag2 keeps it, with numbers as every release reads them."""
        forever = "{sec: 9223372036, nsec: 854775807}"
        return (
            f"- {{history: {KEEP_LAST}, depth: {self.depth}, reliability: {self.reliability}, "
            f"durability: {self.durability}, deadline: {forever}, lifespan: {forever}, liveliness: 1, "
            f"liveliness_lease_duration: {forever}, avoid_ros_namespace_conventions: false}}"
        )


STANDARD = Qos(10, RELIABLE, VOLATILE)
SENSOR_DATA = Qos(5, BEST_EFFORT, VOLATILE)
LATCHED = Qos(1, RELIABLE, TRANSIENT_LOCAL)


@dataclass(frozen=True, slots=True)
class Topic:
    """Type of a topic and what its publisher offers."""

    type_name: str
    qos: Qos


def metadata_yaml(
    file: str, topics: Mapping[str, Topic], messages: Mapping[str, int], first_ns: int, last_ns: int
) -> str:
    """The text for one file of messages; topics without messages are left out."""
    count, duration_ns = sum(messages.values()), last_ns - first_ns
    rows = "".join(
        f"    - topic_metadata:\n"
        f"        name: {name}\n"
        f"        type: {topics[name].type_name}\n"
        f"        serialization_format: cdr\n"
        f"        offered_qos_profiles:\n"
        f"          {topics[name].qos.as_text}\n"
        f"        type_description_hash: {type_hash(topics[name].type_name)}\n"
        f"      message_count: {messages[name]}\n"
        for name in sorted(messages)
    )
    return (
        f"rosbag2_bagfile_information:\n"
        f"  version: {VERSION}\n"
        f"  storage_identifier: mcap\n"
        f"  duration:\n    nanoseconds: {duration_ns}\n"
        f"  starting_time:\n    nanoseconds_since_epoch: {first_ns}\n"
        f"  message_count: {count}\n"
        f"  topics_with_message_count:\n{rows}"
        f'  compression_format: ""\n  compression_mode: ""\n'
        f"  relative_file_paths:\n    - {_quoted(file)}\n"
        f"  files:\n"
        f"    - path: {_quoted(file)}\n"
        f"      starting_time:\n        nanoseconds_since_epoch: {first_ns}\n"
        f"      duration:\n        nanoseconds: {duration_ns}\n"
        f"      message_count: {count}\n"
        f"  custom_data: ~\n"
        f"  ros_distro: jazzy\n"
    )


def _quoted(text: str) -> str:
    """A name of a file as YAML takes it, whatever is in it."""
    escaped = text.replace("'", "''")
    return f"'{escaped}'"
