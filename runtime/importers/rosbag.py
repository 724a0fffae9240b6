"""Recordings of ROS with a LaserScan and an Odometry as the same arrays that other sets come in."""

import math
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from drivers.measurements import FloatArray, RangeArray
from runtime.errors import DataSetError
from runtime.importers.archive import Archive
from runtime.importers.bags.message import BROKEN, LONGEST_NAME, Bag, BagMessage
from runtime.importers.bags.open_bag import open_bag
from runtime.importers.parsing.beams import MOST_BEAMS, padded_ranges
from runtime.importers.parsing.checks import checked
from runtime.importers.parsing.left_out import LeftOut
from runtime.importers.parsing.transforms import between, matrix
from runtime.printable import printable

SCAN_TYPE, ODOMETRY_TYPE = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
TRANSFORM_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
USUAL = {SCAN_TYPE: "/scan", ODOMETRY_TYPE: "/odom"}
OPTIONS = {SCAN_TYPE: "--scan-topic", ODOMETRY_TYPE: "--odom-topic"}
ODOMETRY_FRAME = "odom"
FAR_M = 100.0  # range of a laser whose messages do not say
SWEEP_SHARE = 1.1  # of the time between two scans: longer sweeps are a driver's made-up time_increment
MOST_FRAMES = 1000  # pairs of frames that are kept
MOST_LISTED = 40  # topics in a message
LARGEST_MESSAGE = 1 << 20  # bytes: a scan of 32768 beams has 256 kB, the transforms of a humanoid 10 kB
KEPT_BYTES, KEPT_TIMES = 150_000_000, 4  # of memory for what is kept of a bag: so much, or so many times its size
SCAN_BYTES, BEAM_BYTES, POSE_BYTES = 1500, 12, 1000  # of memory for each, with all that is made of them
LEVEL = 0.97  # cosine of 14 deg: a laser that is tilted more sees the floor


class Topics(NamedTuple):
    """Topics that were named; None: the only one of its kind, or the usual one, is taken."""

    scan: str | None = None
    odometry: str | None = None


class _Scan(NamedTuple):
    """What is used of a LaserScan."""

    frame: str
    ranges: RangeArray
    angle_min: float
    angle_max: float
    angle_increment: float
    time_increment: float
    range_min: float
    range_max: float


@dataclass(slots=True)
class _Gathered:
    """What the messages held, in the order of recording. scans: with their stamps. room_bytes: of memory, for more."""

    room_bytes: int
    scans: list[tuple[float, _Scan]] = field(default_factory=list)
    odometry: list[tuple[float, float, float, float]] = field(default_factory=list)
    transforms: dict[tuple[str, str], FloatArray] = field(default_factory=dict)
    bases: list[tuple[float, float, float, float]] = field(default_factory=list)
    base_frame: str = ""


def load_rosbag(source: Path, head: bytes, topics: Topics) -> Archive:
    """Read a bag. Raises DataSetError where it holds no scan, or where several topics could be meant."""
    bag, left_out = open_bag(source, head), LeftOut()
    scan_topic = _topic(source, bag, SCAN_TYPE, topics.scan, left_out)
    odometry_topic = _topic(source, bag, ODOMETRY_TYPE, topics.odometry, left_out)
    if scan_topic is None:
        raise DataSetError(
            f"{source} has no topic of type {SCAN_TYPE}; its topics: {_listed(bag)}; nothing was written"
        )
    found = _gather(source, bag, scan_topic, odometry_topic, left_out)
    if bag.damage:
        left_out.warnings.append(f"{source.name} is read as far as possible: {bag.damage}")
    if not found.scans:
        why = "; ".join(filter(None, (left_out.first(), *left_out.warnings)))
        told = f" ({why})" if why else ""
        raise DataSetError(f"{source}: {scan_topic} holds no readable message{told}; nothing was written")
    if odometry_topic is None and found.bases:
        left_out.notes.append(f"there is no topic of type {ODOMETRY_TYPE}; the motion in /tf is used as odometry")
        found.odometry = found.bases
    arrays, meta = _scans(found)
    meta["name"] = f"bag {source.stem}"
    _mount(found, meta, left_out)
    if found.odometry:
        rows = np.array(found.odometry)
        arrays |= {"odom_t": rows[:, 0], "odom_pose": rows[:, 1:]}
    return Archive(str(meta["name"]), source, checked(source, arrays, meta, left_out), meta, left_out)


def _topic(source: Path, bag: Bag, type_name: str, named: str | None, left_out: LeftOut) -> str | None:
    """The topic of a type: the one that was named, the only one, or the usual one; None where there is none."""
    candidates = sorted(topic for topic, kind in bag.topics.items() if kind == type_name)
    if named is not None:
        if named in candidates:
            return named
        raise DataSetError(
            f"{source} has no topic {named} of type {type_name} ({OPTIONS[type_name]}); its topics: {_listed(bag)}"
        )
    if len(candidates) < 2:
        return candidates[0] if candidates else None
    if USUAL[type_name] in candidates:
        others = _some([topic for topic in candidates if topic != USUAL[type_name]])
        left_out.notes.append(f"{USUAL[type_name]} is used; {OPTIONS[type_name]} chooses another: {others}")
        return USUAL[type_name]
    raise DataSetError(
        f"{source} has {len(candidates)} topics of type {type_name}: {_some(candidates)}; choose one with "
        f"{OPTIONS[type_name]}"
    )


def _listed(bag: Bag) -> str:
    return _some([f"{topic} ({kind})" for topic, kind in sorted(bag.topics.items())]) or "none"


def _some(names: list[str]) -> str:
    more = len(names) - MOST_LISTED
    return ", ".join(names[:MOST_LISTED]) + (f" and {more} more" if more > 0 else "")


@cache
def _store(is_ros1: bool) -> Any:
    """The types as they are defined in every release of either ROS; takes 0.1 s the first time."""
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    if TRANSFORM_TYPES[0] not in store.types:  # that of ROS 1 lacks it
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORM_TYPES[0]))
    return store


def _decoded(message: BagMessage, type_name: str) -> Any:
    if type_name in TRANSFORM_TYPES:
        type_name = TRANSFORM_TYPES[0]
    store = _store(message.is_ros1)
    return (store.deserialize_ros1 if message.is_ros1 else store.deserialize_cdr)(message.data, type_name)


def _gather(source: Path, bag: Bag, scan_topic: str, odometry_topic: str | None, left_out: LeftOut) -> _Gathered:
    """All messages of the chosen topics and of the transforms, as far as they fit into memory."""
    found = _Gathered(max(KEPT_BYTES, KEPT_TIMES * bag.size_bytes))
    transform_topics = {topic for topic, kind in bag.topics.items() if kind in TRANSFORM_TYPES}
    wanted = {scan_topic, odometry_topic or scan_topic} | transform_topics
    for message in bag.messages(wanted):
        if found.room_bytes < 0:
            until_s = 1e-9 * message.log_ns
            left_out.warnings.append(
                f"{source.name} holds more than fits into memory and is read up to {until_s:.3f} s; split it"
            )
            break
        what = {scan_topic: "scans", odometry_topic: "odometry samples"}.get(message.topic, "transforms")
        if len(message.data) > LARGEST_MESSAGE:
            left_out.add(what, f"the message has more than {LARGEST_MESSAGE} bytes", message.topic)
            continue
        try:
            told = _decoded(message, bag.topics[message.topic])
        except (SerdeError, *BROKEN) as error:
            left_out.add(what, "the message cannot be decoded", f"{message.topic}: {error}")
            continue
        if message.topic == scan_topic and len(told.ranges) > MOST_BEAMS:
            left_out.add(what, f"more than {MOST_BEAMS} beams", message.topic)
        elif message.topic == scan_topic:
            found.scans.append((_stamp_s(told.header, message), _scan_of(told)))
            found.room_bytes -= SCAN_BYTES + BEAM_BYTES * len(told.ranges)
        elif message.topic == odometry_topic:
            found.odometry.append((_stamp_s(told.header, message), *_planar(told.pose.pose)))
            found.base_frame = found.base_frame or _frame(told.child_frame_id)
            found.room_bytes -= POSE_BYTES
        else:
            _note_transforms(told.transforms, message, found)
    return found


def _note_transforms(transforms: list[Any], message: BagMessage, found: _Gathered) -> None:
    """Keep the first of each pair of frames, and the motion of the base in the frame of the odometry."""
    for each in transforms:
        parent, child = _frame(each.header.frame_id), _frame(each.child_frame_id)
        offset, turn = each.transform.translation, each.transform.rotation
        whole = matrix((offset.x, offset.y, offset.z), (turn.x, turn.y, turn.z, turn.w))
        if parent == ODOMETRY_FRAME:
            heading_rad = math.atan2(whole[1, 0], whole[0, 0])
            found.bases.append((_stamp_s(each.header, message), offset.x, offset.y, heading_rad))
            found.base_frame = found.base_frame or child
            found.room_bytes -= POSE_BYTES
        else:
            if len(found.transforms) < MOST_FRAMES:
                found.transforms.setdefault((parent, child), whole)


def _scan_of(told: Any) -> _Scan:
    """A copy: the message holds intensities and all of its bytes as well."""
    numbers = (told.angle_min, told.angle_max, told.angle_increment, told.time_increment, told.range_min)
    return _Scan(_frame(told.header.frame_id), np.array(told.ranges, np.float32), *numbers, told.range_max)


def _frame(name: str) -> str:
    return printable(name[: LONGEST_NAME + 1].lstrip("/"), LONGEST_NAME)


def _stamp_s(header: Any, message: BagMessage) -> float:
    """When it was measured; of a driver that leaves the stamp empty, when it was recorded."""
    stamp_ns = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec
    return (stamp_ns or message.log_ns) * 1e-9


def _planar(pose: Any) -> tuple[float, float, float]:
    turn = pose.orientation
    whole = matrix((0.0, 0.0, 0.0), (turn.x, turn.y, turn.z, turn.w))
    return pose.position.x, pose.position.y, math.atan2(whole[1, 0], whole[0, 0])


def _scans(found: _Gathered) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arrays and description of the scans; each keeps its own bearings, because some lasers turn unevenly."""
    scans = [told for _, told in found.scans]
    stamps_s = np.array([stamp_s for stamp_s, _ in found.scans])
    counts = np.array([len(told.ranges) for told in scans])
    arrays = {
        "scan_t": stamps_s,
        "ranges": padded_ranges([told.ranges for told in scans]),
        "scan_angle_min": np.array([told.angle_min for told in scans], np.float64),
        "scan_angle_increment": np.array([_increment_rad(told) for told in scans], np.float64),
        "scan_beams": counts,
    }
    usable = counts > 0  # a laser that has just been switched on sends scans without beams
    farthest_m = [told.range_max for told in scans if 0.0 < told.range_max < math.inf]
    nearest_m = [told.range_min for told in scans if 0.0 <= told.range_min < math.inf]
    return {name: array[usable] for name, array in arrays.items()}, {
        "range_max": float(max(farthest_m, default=FAR_M)),
        "range_min": float(min(nearest_m, default=0.0)),
        "time_increment": _time_increment_s(scans, stamps_s, counts),
    }


def _increment_rad(told: _Scan) -> float:
    beams = len(told.ranges)
    if told.angle_increment == 0.0 and beams > 1:
        return float((told.angle_max - told.angle_min) / (beams - 1))
    return float(told.angle_increment)


def _time_increment_s(scans: list[_Scan], stamps_s: FloatArray, counts: Any) -> float:
    """s from one beam to the next; 0 where that would be longer than the scans are apart."""
    told_s = float(np.median([told.time_increment for told in scans]))
    apart_s = np.diff(stamps_s)
    usual_s = float(np.median(apart_s[apart_s > 0.0])) if (apart_s > 0.0).any() else 0.0
    return told_s if 0.0 < told_s * float(np.median(counts)) <= SWEEP_SHARE * usual_s else 0.0


def _mount(found: _Gathered, meta: dict[str, Any], left_out: LeftOut) -> None:
    """Where the laser sits on the base, from the transforms."""
    frame = found.scans[0][1].frame
    base_from_laser = between(found.transforms, found.base_frame, frame) if found.base_frame else None
    if base_from_laser is None:
        if frame != found.base_frame:
            left_out.notes.append(
                f"no transform leads from {found.base_frame or 'a base'} to {frame or 'the laser'}; set "
                "slam.mount if the laser is not in the middle of the wheels' axle"
            )
        return
    up = float(base_from_laser[2, 2])
    if abs(up) < LEVEL:
        left_out.warnings.append(
            f"{frame} is tilted by {math.degrees(math.acos(min(abs(up), 1.0))):.0f} deg; its scans are used "
            "as if it were level"
        )
    yaw_rad = math.atan2(base_from_laser[1, 0], base_from_laser[0, 0])
    place = zip(("laser_x", "laser_y", "laser_yaw"), (*base_from_laser[:2, 3].tolist(), yaw_rad), strict=True)
    meta["vehicle"] = {name: round(value, 9) for name, value in place} | (
        {"laser_upside_down": True} if up < 0.0 else {}
    )
