"""A saved map in bytes: one line with format and size, a header in JSON, arrays, and a sha256 over all of it."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drivers.measurements import FloatArray
from runtime.errors import NotAMapError
from runtime.map_files.origin import MapOrigin
from runtime.printable import printable
from slam.joint.atlas import PARENTS
from slam.joint.state import MOST_IN_STATE
from slam.joint.window import ORPHAN
from slam.maps.joint_map import JointMap
from slam.maps.views import BEAMS, MOST_VIEWS

MAGIC, FORMAT = b"INFANTMAP", 2
SHA_BYTES = 32
FIRST_LINE_BYTES = 64
LEAST_LANDMARKS = 2  # fewer leave the heading open
MOST = {"landmarks": 25_000, "in_state": MOST_IN_STATE, "views": MOST_VIEWS}
"""By key of the header. 25 000 landmarks are those of 250 km of ordinary ground, and are indexed in a second."""
MOST_IN_A_PATCH = 50  # landmarks in a square of PATCH_M: a wall of doors has some ten
PATCH_M = 1.0
MOST_HEADER_BYTES = 4 << 20  # a configuration, and the names of some thousands of runs
SHAPES: dict[str, tuple[str, tuple[int | str, ...]]] = {
    "identities": ("<i8", ("L",)),
    "log_odds": ("<f8", ("L",)),
    "looks": ("<f8", ("L",)),
    "finds": ("<f8", ("L",)),
    "missed": ("|b1", ("L",)),
    "means_m": ("<f8", ("L", 2)),
    "covariances_m2": ("<f8", ("L", 2, 2)),
    "parents": ("<i8", ("L", PARENTS)),
    "weights": ("<f8", ("L", 2, 2 * PARENTS)),
    "residuals": ("<f8", ("L", 2, 2)),
    "block_m2": ("<f8", ("S", "S")),
    "after_miss": ("<f8", (2,)),
    "view_poses": ("<f8", ("K", 3)),
    "view_points_cm": ("<i2", ("K", BEAMS, 2)),
}
NAMES = {"landmarks": "landmarks", "in_state": "landmarks with a joint covariance", "views": "views"}
TEXTS = ("created_utc", "configuration", "frame", "rover", "predecessor", "slam_sources")
LARGEST: dict[str, float] = {
    "means_m": 1e6,
    "covariances_m2": 1e6,
    "weights": 1e3,
    "residuals": 1e6,
    "block_m2": 1e6,
    "log_odds": 1e6,
    "looks": 1e12,
    "finds": 1e12,
    "after_miss": 1e12,
    "view_poses": 1e6,
}
"""Magnitudes that no drive reaches: beyond them squares overflow."""
LEAST_VARIANCE_M2 = 1e-13  # that a landmark may have left; the filter leaves ten times as much (slam/joint/window.py)
ROUNDING = 1e-6  # of the largest variance
FAR = 1 << 60  # of numbers of landmarks and scans


@dataclass(frozen=True, slots=True)
class MapFacts:
    """Where a map comes from. configuration_text: of the drive that made it; runs: all drives that are in it, oldest
    first; predecessor: sha256 of the file that the last of them began in, "" if it began without one. origin: where on
    earth it lies, where that was configured.
    """

    created_utc: str
    configuration_text: str
    runs: tuple[str, ...]
    frame: str = "map"
    rover: str = ""
    predecessor: str = ""
    slam_sources: str = ""
    origin: MapOrigin | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SavedMap:
    """A map with its origin; sha256: of its file, hexadecimal."""

    joint: JointMap
    facts: MapFacts
    sha256: str = field(default="")


def encode_map(joint: JointMap, facts: MapFacts) -> bytes:
    """The bytes of a file. Raises NotAMapError where it would be one that nobody could read."""
    sizes = {"landmarks": len(joint), "in_state": joint.in_state, "views": len(joint.views)}
    _refuse_excess("the map", sizes, joint.means_m)
    arrays = [np.ascontiguousarray(array, dtype=SHAPES[name][0]) for name, array in joint.arrays.items()]
    header = {
        "scans": joint.scans,
        "landmarks": len(joint),
        "in_state": joint.in_state,
        "views": len(joint.views),
        "created_utc": facts.created_utc,
        "frame": facts.frame,
        "rover": facts.rover,
        "runs": list(facts.runs),
        "predecessor": facts.predecessor,
        "slam_sources": facts.slam_sources,
        "origin": None if facts.origin is None else facts.origin.model_dump(),
        "configuration_sha256": hashlib.sha256(facts.configuration_text.encode()).hexdigest(),
        "configuration": facts.configuration_text,
        "arrays": list(joint.arrays),
    }
    text = json.dumps(header).encode()
    if len(text) >= MOST_HEADER_BYTES:
        raise NotAMapError(
            f"the map's configuration and names of runs have {len(text)} bytes, expected less than "
            f"{MOST_HEADER_BYTES}; save a new map"
        )
    body = text + b"\n" + b"".join(array.tobytes() for array in arrays)
    line = MAGIC + b" %d " % FORMAT
    size = len(line) + 21 + len(body) + SHA_BYTES
    data = line + b"%020d\n" % size + body
    return data + hashlib.sha256(data).digest()


def decode_map(data: bytes, name: str) -> SavedMap:
    """Back again. Raises NotAMapError with one sentence that says what is wrong with the file called `name`."""
    if not data:
        raise NotAMapError(f"{name} is empty; save the map again with infant map save")
    line, newline, _ = data[:FIRST_LINE_BYTES].partition(b"\n")
    words = line.split(b" ")
    if words[0] != MAGIC or not newline or len(words) != 3 or not all(word.isdigit() for word in words[1:]):
        if MAGIC.startswith(data[: len(MAGIC)]) or words[0] == MAGIC:
            raise NotAMapError(f"{name} is cut off or damaged in its first line; take another copy of the map")
        raise NotAMapError(f"{name} is not a map; give a file that infant map save wrote")
    version, size = int(words[1]), int(words[2])
    if len(data) < size:
        raise NotAMapError(f"{name} is cut off: it has {len(data)} of {size} bytes; take another copy of the map")
    if len(data) > size or hashlib.sha256(memoryview(data)[:-SHA_BYTES]).digest() != data[-SHA_BYTES:]:
        raise NotAMapError(f"{name} is damaged: its sha256 differs from the one it was written with; take another copy")
    if version != FORMAT:
        raise NotAMapError(
            f"{name} has format {version}, but this release reads {FORMAT}; use the release that wrote it"
        )
    begin = len(line) + 1
    end = data.find(b"\n", begin, begin + MOST_HEADER_BYTES)
    if end < 0:
        raise NotAMapError(
            f"{name} has a header that does not end within {MOST_HEADER_BYTES} bytes; take another copy of the map"
        )
    try:
        header = json.loads(data[begin:end])
        sizes = {key: int(header[key]) for key in MOST}
        _refuse_excess(name, sizes)
        joint = _decode_joint(header, sizes, memoryview(data)[end + 1 : -SHA_BYTES])
        _refuse_excess(name, sizes, joint.means_m)
        told = {name: _text(name, header[name]) for name in TEXTS}
        facts = MapFacts(
            told["created_utc"],
            told["configuration"],
            tuple(_text("runs", run) for run in header["runs"]),
            told["frame"],
            told["rover"],
            told["predecessor"],
            told["slam_sources"],
            None if header.get("origin") is None else MapOrigin.model_validate(header["origin"]),
        )
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise NotAMapError(
            f"{name} cannot be read as a map ({printable(str(error), 200)}); take another copy of the map"
        ) from error
    return SavedMap(joint, facts, hashlib.sha256(data).hexdigest())


def _refuse_excess(name: str, sizes: Mapping[str, int], means_m: FloatArray | None = None) -> None:
    """Raises NotAMapError where a map holds more than any drive needs; means_m (L, 2) of its landmarks."""
    for key, most in MOST.items():
        if not 0 <= sizes[key] <= most:
            raise NotAMapError(
                f"{name} has {sizes[key]} {NAMES[key]}, expected at most {most}; save maps of shorter drives"
            )
    if means_m is None or len(means_m) == 0:
        return
    patches, counts = np.unique(np.floor(means_m / PATCH_M), axis=0, return_counts=True)
    if counts.max() > MOST_IN_A_PATCH:
        x_m, y_m = (PATCH_M * patches[counts.argmax()]).tolist()
        raise NotAMapError(
            f"{name} has {counts.max()} landmarks within {PATCH_M:g} m of x {x_m:g} m, y {y_m:g} m, expected at most "
            f"{MOST_IN_A_PATCH}; save a new map"
        )


def _text(name: str, value: object) -> str:
    """Raises ValueError where a fact is none."""
    if not isinstance(value, str):
        raise ValueError(f"{name} is {value!r:.40}, expected text")
    return value


def _decode_joint(header: dict[str, Any], counts: Mapping[str, int], payload: memoryview) -> JointMap:
    """Raises ValueError where the arrays do not make a map."""
    sizes = {"L": counts["landmarks"], "S": 2 * counts["in_state"], "K": counts["views"]}
    arrays: dict[str, Any] = {}
    offset = 0
    for name in header["arrays"]:
        kind, symbols = SHAPES[name]
        shape = tuple(sizes[size] if isinstance(size, str) else size for size in symbols)
        count = int(np.prod(shape))
        arrays[name] = np.frombuffer(payload, kind, count, offset).reshape(shape).copy()
        offset += arrays[name].nbytes
    if offset != len(payload) or arrays.keys() != SHAPES.keys():
        raise ValueError("its arrays differ from those that its header lists")
    joint = JointMap(**arrays, scans=int(header["scans"]))
    numbers = np.arange(len(joint))[:, None]
    if not ((joint.parents >= ORPHAN) & (joint.parents < numbers)).all():
        raise ValueError("a landmark refers to one that comes after it")
    if not all(np.isfinite(array).all() for array in arrays.values()):
        raise ValueError("a number in it is not finite")
    for name, most in LARGEST.items():
        if not (np.abs(arrays[name]) <= most).all():
            raise ValueError(f"a number of {name} is beyond {most:g}")
    if not (0 <= joint.scans < FAR >> 12 and ((joint.identities >= 0) & (joint.identities < FAR)).all()):
        raise ValueError("a landmark or the number of scans has an impossible count")
    hangs = joint.parents.max(axis=1, initial=ORPHAN) >= 0
    left = np.where(hangs[:, None, None], joint.residuals, joint.covariances_m2)[joint.in_state :]
    if not (_least_variances(left) >= LEAST_VARIANCE_M2).all() or not (_least_variances(_own(joint)) >= 0.0).all():
        raise ValueError("a covariance in it is not valid")
    if not _is_covariance(joint.block_m2):
        raise ValueError("the joint covariance in it is not valid")
    looks, finds = np.append(joint.looks, joint.after_miss[0]), np.append(joint.finds, joint.after_miss[1])
    if not ((finds >= 0.0) & (finds <= looks)).all() or not joint.after_miss[1] < joint.after_miss[0]:
        raise ValueError("a landmark in it was found more often than it was in view")
    if len(np.unique(joint.identities)) != len(joint):
        raise ValueError("two of its landmarks have the same name")
    return joint


def _is_covariance(block_m2: FloatArray) -> bool:
    """Whether a matrix (S, S) is the same along rows and columns and has no negative variance in any direction, but for
    what is lost in rounding.
    """
    rounding = ROUNDING * float(np.diagonal(block_m2).max(initial=0.0))
    if not (np.abs(block_m2 - block_m2.T) <= rounding).all():
        return False
    try:
        np.linalg.cholesky(block_m2 + np.diag(np.full(len(block_m2), rounding + LEAST_VARIANCE_M2)))
    except np.linalg.LinAlgError:
        return False
    return True


def _own(joint: JointMap) -> FloatArray:
    """(S, 2, 2) covariances of the landmarks in the joint one."""
    blocks = joint.block_m2.reshape(joint.in_state, 2, joint.in_state, 2)
    numbers = np.arange(joint.in_state)
    return blocks[numbers, :, numbers, :]


def _least_variances(covariances_m2: FloatArray) -> FloatArray:
    """(n,) the smaller variance of each (n, 2, 2), -1 where a covariance is none."""
    first, second, cross = covariances_m2[:, 0, 0], covariances_m2[:, 1, 1], covariances_m2[:, 0, 1]
    are_some = np.abs(cross) <= (1.0 + 1e-9) * np.sqrt(np.maximum(first, 0.0) * np.maximum(second, 0.0))
    least: FloatArray = np.where(are_some, np.minimum(first, second), -1.0)
    return least
