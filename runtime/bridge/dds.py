"""A DDS participant that ROS 2 nodes take for one of theirs: CDR goes through it untouched, without any ROS."""

import socket
from collections.abc import Sequence
from typing import Any
from xml.sax.saxutils import quoteattr

from runtime.bridge.topics import BridgedTopic
from runtime.errors import SensorError
from runtime.messages.definitions import type_store
from runtime.optional_packages import needs
from runtime.publish.ros2_keys import dds_type, type_hash

LOOPBACK = "lo"
EPROSIMA = "1.15"  # vendor id: the type information of Fast DDS 3 (Kilted) is none that Cyclone can resolve


def configuration_xml(interface: str) -> str:
    """Of Cyclone DDS: one interface and no other; on loopback nothing is sent by multicast."""
    general = f"<Interfaces><NetworkInterface name={quoteattr(interface)}/></Interfaces>"
    discovery = "<ParticipantIndex>auto</ParticipantIndex>"
    if interface == LOOPBACK:
        general += "<AllowMulticast>false</AllowMulticast>"
        discovery += '<Peers><Peer Address="127.0.0.1"/></Peers>'
    compatibility = f"<IgnoreTypeInformation>{EPROSIMA}</IgnoreTypeInformation>"
    return (
        f'<CycloneDDS><Domain Id="any"><General>{general}</General><Discovery>{discovery}</Discovery>'
        f"<Compatibility>{compatibility}</Compatibility></Domain></CycloneDDS>"
    )


class DdsParticipant:
    """Writers of raw CDR, and readers of typed messages, in one domain on one interface."""

    def __init__(self, domain: int, interface: str) -> None:
        """Raises UsageError where cyclonedds is not installed, SensorError where the interface cannot be used."""
        if interface not in (known := [name for _, name in socket.if_nameindex()]):
            raise SensorError(f"no network interface {interface!r} here; --interface takes one of {', '.join(known)}")
        with needs("cyclonedds", "infant bridge ros2"):
            from cyclonedds.core import DDSException
            from cyclonedds.domain import Domain, DomainParticipant
        try:
            self._domain = Domain(domain, configuration_xml(interface))
            self._participant = DomainParticipant(domain)
        except DDSException as error:
            raise SensorError(
                f"no DDS participant on {interface!r} in domain {domain} ({error.msg}); give an interface of this "
                "machine with --interface: ip link shows them"
            ) from error

    def writer(self, topic: BridgedTopic) -> "RawWriter":
        """A writer of a topic."""
        from cyclonedds.pub import DataWriter

        return RawWriter(DataWriter(self._participant, self._topic(topic), qos=_qos(topic)))

    def reader(self, topic: BridgedTopic) -> "TypedReader":
        """A reader of a topic."""
        from cyclonedds.sub import DataReader

        return TypedReader(DataReader(self._participant, self._topic(topic), qos=_qos(topic)))

    def _topic(self, topic: BridgedTopic) -> Any:
        from cyclonedds.topic import Topic

        return Topic(self._participant, f"rt{topic.name}", idl_type(topic.type_name))


class RawWriter:
    """Writes messages that are CDR already."""

    def __init__(self, writer: Any) -> None:
        from cyclonedds._clayer import ddspy_write

        self._write, self._writer = ddspy_write, writer

    def write(self, data: bytes) -> None:
        """Send one message."""
        self._write(self._writer._ref, data)

    def readers(self) -> int:
        """How many nodes read it now."""
        return len(self._writer.get_matched_subscriptions())


class TypedReader:
    """Takes messages that nodes write, as objects with the fields of their type."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader

    def take(self) -> Any:
        """The oldest message that has not been taken; None where there is none."""
        samples = self._reader.take(1)
        return samples[0] if samples and hasattr(samples[0], "header") else None  # else a writer has gone


def idl_type(type_name: str, made: dict[str, Any] | None = None) -> Any:
    """The IDL struct of a ROS type, such as geometry_msgs::msg::dds_::Pose_, made of the type store's definition."""
    from cyclonedds.idl import make_idl_struct

    made = {} if made is None else made
    if type_name not in made:
        fields = {name: _idl_field(kind, made) for name, kind in type_store().fielddefs[type_name][1]}
        fields = fields or {"structure_needs_at_least_one_member": _scalar("uint8")}
        made[type_name] = make_idl_struct(f"{type_name.split('/')[-1]}_", dds_type(type_name), fields)
    return made[type_name]


def _idl_field(kind: Any, made: dict[str, Any]) -> Any:
    from cyclonedds.idl import types

    node, what = kind
    match node.name:
        case "BASE":
            return _scalar(what[0])
        case "NAME":
            return idl_type(what, made)
        case "ARRAY":
            return types.array[_idl_field(what[0], made), what[1]]  # type: ignore[misc]  # made by their metaclass
        case _:
            return types.sequence[_idl_field(what[0], made)]  # type: ignore[misc]


def _scalar(name: str) -> Any:
    from cyclonedds.idl import types

    if name in ("bool", "string"):
        return {"bool": bool, "string": str}[name]
    return getattr(types, {"byte": "uint8", "octet": "uint8", "char": "uint8"}.get(name, name))


def _qos(topic: BridgedTopic) -> Any:
    from cyclonedds.core import Policy, Qos
    from cyclonedds.util import duration

    policies: Sequence[Any] = (
        Policy.Reliability.Reliable(duration(milliseconds=100)) if topic.reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if topic.latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(topic.depth),
        Policy.DurabilityService(
            cleanup_delay=0,
            history=Policy.History.KeepLast(topic.depth),
            max_samples=-1,
            max_instances=-1,
            max_samples_per_instance=-1,
        ),
        Policy.Userdata(f"typehash={type_hash(topic.type_name)};".encode()),
    )
    return Qos(*policies)
