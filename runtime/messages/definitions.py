"""The message types of a run: standard ROS 2 ones where they fit, own ones (package infant_msgs) where none does.

An own definition may grow at its end; what is there keeps its order, because old runs must stay readable.
"""

import struct
from functools import cache
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

CAN_FRAME = """\
std_msgs/Header header
uint32 id
bool is_rtr
bool is_extended
bool is_error
uint8 dlc
uint8[8] data
"""

CAN_FD_FRAME = """\
# what can_msgs/Frame has no room for
std_msgs/Header header
uint32 id
bool is_extended
uint8[] data
"""

TICK = """\
# All that the estimator saw on one beat, to the last bit. Stamps are host monotonic nanoseconds.
uint8 NOTHING=0
uint8 SCAN=1       # its ranges are the LaserScan just before this message on /scan
uint8 SIGHTINGS=2
int64 seq
int64 stamp_ns
uint8 seen
int64 seen_stamp_ns
float64 beam_period_s
int32 stamp_beam
float64 range_max_m
# bearing of beam k is first + k * increment in float64, unless bearings_rad holds them all
float64 bearing_first_rad
float64 bearing_increment_rad
float64[] bearings_rad
float64[] sighting_ranges_m
float64[] sighting_bearings_rad
int64[] sighting_identities
# wheel samples: one kind, one stamp and three values each
uint8 COUNTS=0         # left, right (counts), valid (0 or 1; 2: valid, and unbroken since the last valid one)
uint8 SPEED_STEERING=1 # m/s, rad, 0
uint8 SPEED_YAW_RATE=2 # m/s, rad/s, 0
uint8 ODOMETRY_POSE=3  # m, m, rad
uint8[] wheel_kinds
int64[] wheel_stamps_ns
float64[] wheel_values
int64[] event_stamps_ns
string[] event_sources
string[] event_kinds
string[] event_reasons
string[] event_severities
"""

ESTIMATE = """\
# Poses are x m, y m, heading rad. What only a reviewer looks at is float32.
int64 stamp_ns
float64[3] map_from_body
float64[9] covariance
float64[3] particle_mean
float64[9] particle_covariance
float64[3] odom_from_body
string quality
bool has_particles
float32[] particles          # three each
float32[] particle_weights
bool has_features
int64 features_stamp_ns
float32[] feature_ranges_m
float32[] feature_bearings_rad
float32[] feature_covariances # four each
uint8[] feature_may_create
int64[] feature_identities
int32[] feature_beams
int64[] matches              # identity of the landmark, or a negative verdict
bool has_beam_verdicts
uint8[] beam_verdicts
bool has_landmarks
int64[] landmark_identities
float64[] landmark_means_m   # two each
float32[] landmark_covariances_m2 # four each
float32[] landmark_existence_log_odds
string[] count_names
float64[] count_values
"""

STATE_HASH = """\
# Hash of the whole state of the filter after this tick: where two replays part is where it first differs.
int64 seq
int64 stamp_ns
uint8[] state_hash
"""

TIMING = """\
# How the loop kept time on this tick; the estimator never sees it.
int64 seq
int64 stamp_ns
int64 lateness_ns
int64 missed
string[] stage_names
int64[] stage_durations_ns
"""

TRUTH = """\
# Where a simulated rover really was: map_from_body, x m, y m, heading rad.
int64 stamp_ns
float64[3] map_from_body
"""

RAW_LASER = """\
# Bytes of the laser's wire as they were read or written.
int64 stamp_ns
bool sent
uint8[] data
"""

GAP = """\
# The record lost this much before this stamp: the queue was full or the disk refused.
int64 stamp_ns
int64 ticks
int64 raw
string reason
"""

DEFECT = """\
# The step of this tick raised and ended as a prediction without its scan; the tick holds what made it raise.
int64 stamp_ns
string reason
"""

DEFINITIONS = {
    "can_msgs/msg/Frame": CAN_FRAME,
    "infant_msgs/msg/CanFdFrame": CAN_FD_FRAME,
    "infant_msgs/msg/Tick": TICK,
    "infant_msgs/msg/Estimate": ESTIMATE,
    "infant_msgs/msg/StateHash": STATE_HASH,
    "infant_msgs/msg/Timing": TIMING,
    "infant_msgs/msg/Truth": TRUTH,
    "infant_msgs/msg/RawLaser": RAW_LASER,
    "infant_msgs/msg/Gap": GAP,
    "infant_msgs/msg/Defect": DEFECT,
}

TYPES = {
    "/scan": "sensor_msgs/msg/LaserScan",
    "/tick": "infant_msgs/msg/Tick",
    "/pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "/odom": "nav_msgs/msg/Odometry",
    "/estimate": "infant_msgs/msg/Estimate",
    "/timing": "infant_msgs/msg/Timing",
    "/truth": "infant_msgs/msg/Truth",
    "/state_hash": "infant_msgs/msg/StateHash",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/raw/laser": "infant_msgs/msg/RawLaser",
    "/raw/can": "can_msgs/msg/Frame",
    "/raw/can_fd": "infant_msgs/msg/CanFdFrame",
    "/gap": "infant_msgs/msg/Gap",
    "/defect": "infant_msgs/msg/Defect",
}
"""Topic of a run: name of its type."""


@cache
def type_store() -> Any:
    """The rosbags store that knows all of TYPES; takes 0.1 s the first time."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store


def definition(type_name: str) -> str:
    """Full text of a type with all that it contains, as an MCAP schema of encoding ros2msg wants it."""
    own = DEFINITIONS.get(type_name, "")
    if own and "Header" not in own:
        return own  # with its comments, which the store drops
    text: str = type_store().generate_msgdef(type_name, ros_version=2)[0]
    return text


def serialize(type_name: str, message: Any) -> bytes:
    """CDR, little-endian, with its header of four bytes."""
    return bytes(type_store().serialize_cdr(message, type_name))


def deserialize(type_name: str, data: bytes) -> Any:
    """The message; its arrays are read-only views into the data. Raises ValueError where the data is none of its type.

    What is allocated never exceeds the data much: the library reads element by element, or takes views.
    """
    try:
        return type_store().deserialize_cdr(data, type_name)
    except (SerdeError, struct.error, IndexError, KeyError, TypeError, OverflowError, AssertionError) as error:
        raise ValueError(f"not the bytes of a {type_name} ({error})") from error


def construct(type_name: str, **fields: Any) -> Any:
    """A message of this type."""
    return type_store().types[type_name](**fields)
