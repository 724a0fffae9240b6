# mypy: disable-error-code="valid-type, type-arg"
"""The published messages as pycdr2 knows them: a second reader, written against the definitions of ROS 2."""

from dataclasses import dataclass
from typing import Any

from pycdr2 import IdlStruct
from pycdr2.types import array, float32, float64, int32, sequence, uint32


@dataclass
class Time(IdlStruct, typename="Time"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="Header"):
    stamp: Time
    frame_id: str


@dataclass
class Vector(IdlStruct, typename="Vector"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="Quaternion"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="Pose"):
    position: Vector
    orientation: Quaternion


@dataclass
class PoseWithCovariance(IdlStruct, typename="PoseWithCovariance"):
    pose: Pose
    covariance: array[float64, 36]


@dataclass
class PoseWithCovarianceStamped(IdlStruct, typename="PoseWithCovarianceStamped"):
    header: Header
    pose: PoseWithCovariance


@dataclass
class Twist(IdlStruct, typename="Twist"):
    linear: Vector
    angular: Vector


@dataclass
class TwistWithCovariance(IdlStruct, typename="TwistWithCovariance"):
    twist: Twist
    covariance: array[float64, 36]


@dataclass
class Odometry(IdlStruct, typename="Odometry"):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dataclass
class LaserScan(IdlStruct, typename="LaserScan"):
    header: Header
    angle_min: float32
    angle_max: float32
    angle_increment: float32
    time_increment: float32
    scan_time: float32
    range_min: float32
    range_max: float32
    ranges: sequence[float32]
    intensities: sequence[float32]


@dataclass
class TransformStamped(IdlStruct, typename="TransformStamped"):
    header: Header
    child_frame_id: str
    translation: Vector
    rotation: Quaternion


@dataclass
class TransformMessage(IdlStruct, typename="TransformMessage"):
    transforms: sequence[TransformStamped]


@dataclass
class ColorRGBA(IdlStruct, typename="ColorRGBA"):
    r: float32
    g: float32
    b: float32
    a: float32


@dataclass
class Duration(IdlStruct, typename="Duration"):
    sec: int32
    nanosec: uint32


@dataclass
class Marker(IdlStruct, typename="Marker"):
    """Up to the colours: a test reads no further."""

    header: Header
    ns: str
    id: int32
    type: int32
    action: int32
    pose: Pose
    scale: Vector
    color: ColorRGBA
    lifetime: Duration
    frame_locked: bool
    points: sequence[Vector]
    colors: sequence[ColorRGBA]


@dataclass
class FirstMarker(IdlStruct, typename="FirstMarker"):
    """A MarkerArray of one marker: its count, then the marker."""

    count: uint32
    marker: Marker


def read(kind: type[IdlStruct], data: bytes) -> Any:
    """A message of this kind; Any, because mypy does not know pycdr2's arrays."""
    return kind.deserialize(data)
