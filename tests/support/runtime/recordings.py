"""A small recording of each format that can be imported, as the bytes of its file."""

import shutil
from collections.abc import Callable
from pathlib import Path
from tempfile import mkdtemp

from tests.support.runtime.bags import Made, room_drive, write_bag1, write_mcap
from tests.support.runtime.carmen_logs import moments, robotlaser, room_log, room_ranges
from tests.support.runtime.data_sets import POSES, SCANS, write_set
from tests.support.runtime.scip_captures import as_records, described, scan_messages


def carmen() -> bytes:
    robot = [robotlaser(moment, -1.57, 0.0175, room_ranges(moment)) for moment in moments(3)]
    head = ["PARAM laser_front_laser_fov 3.14159 0 host 0", "PARAM robot_frontlaser_offset 0.1 0 host 0"]
    return "\n".join([*head, *room_log(5), *robot]).encode() + b"\n"


def candump() -> bytes:
    frames = ("181#00FFFFFF25001082", "182#00FFFFFF2500102D", "701#", "181##0AA", "182#R", "20000181#00")
    return b"".join(b"(17000000%02d.5) can0 %s\n" % (k, frame.encode()) for k, frame in enumerate(frames * 4))


def bag(name: str, write: Callable[[Path], Path]) -> bytes:
    folder = Path(mkdtemp())
    try:
        return write(folder / name).read_bytes()
    finally:
        shutil.rmtree(folder)


def npz() -> bytes:
    return bag("set", lambda path: write_set(path, SCANS | POSES, {"name": "carmen of mine"}) / "set.npz")


FILES: dict[str, bytes] = {
    "carmen": carmen(),
    "candump": candump(),
    "scip records": as_records([described(), *scan_messages(2)]),
    "scip bytes": b"".join([described(), *scan_messages(2)]),
    "bag of ros 1": bag("a.bag", lambda path: write_bag1(path, room_drive(Made(True), 3))),
    "mcap": bag("a.mcap", lambda path: write_mcap(path, room_drive(Made(False), 3))),
    "arrays": npz(),
}
