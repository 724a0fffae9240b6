"""A saved map comes back as it was; one that is not as it was is refused in one sentence that says why."""

import math
import os
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.errors import NotAMapError, RunExistsError, StorageError
from runtime.map_files import map_file, map_store
from runtime.map_files.map_file import decode_map, encode_map
from runtime.map_files.map_store import read_map, write_new_map, write_successor
from runtime.record.folder import LARGEST_MAP_BYTES
from slam.maps.joint_map import JointMap
from tests.support.runtime.small_maps import FACTS, map_bytes, small_map


def test_a_map_comes_back_as_it_was() -> None:
    saved = decode_map(map_bytes(), "hall.map")
    assert saved.facts == FACTS
    assert saved.joint.digest() == small_map().digest()
    assert encode_map(saved.joint, saved.facts) == map_bytes()


def test_a_thousand_landmarks_fit_into_two_megabytes() -> None:
    assert len(encode_map(small_map(1000, 150), FACTS)) < 2e6


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda _: b"", "is empty"),
        (lambda _: b"P5\n3 3\n255\n123456789", "is not a map"),
        (lambda _: bytes(range(255, -1, -1)) * 16, "is not a map"),
        (lambda data: data[:5], "is cut off"),
        (lambda data: data[:20], "is cut off"),
        (lambda data: data[:1000], "is cut off: it has 1000 of"),
        (lambda data: data[:-1], "is cut off"),
        (lambda data: data + b"\n", "is damaged"),
    ],
)
def test_what_is_no_whole_map_is_refused(spoil: "object", why: str, tmp_path: Path) -> None:
    path = tmp_path / "hall.map"
    path.write_bytes(spoil(map_bytes()))  # type: ignore[operator]
    with pytest.raises(NotAMapError, match=why):
        read_map(path)


@pytest.mark.parametrize(
    ("name", "value"),
    [("means_m", 1e300), ("covariances_m2", -1e308), ("weights", 1e200), ("block_m2", 1e308), ("after_miss", -1e300)],
)
def test_numbers_that_no_drive_reaches_are_refused(name: str, value: float) -> None:
    whole = small_map()
    spoilt = replace(whole, **{name: np.full_like(getattr(whole, name), value)})
    with pytest.raises(NotAMapError, match=f"a number of {name} is beyond"):
        decode_map(encode_map(spoilt, FACTS), "hall.map")


@pytest.mark.parametrize("changes", [{"scans": 10**30}, {"scans": -1}, {"identities": np.arange(40) - 2**62}])
def test_counts_beyond_all_drives_are_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(NotAMapError, match="an impossible count"):
        decode_map(encode_map(replace(small_map(), **changes), FACTS), "hall.map")


@pytest.mark.parametrize("facts", [{"runs": (1, 2)}, {"rover": 5}, {"frame": ["map"]}, {"created_utc": None}])
def test_facts_that_are_no_text_are_refused(facts: dict[str, Any]) -> None:
    with pytest.raises(NotAMapError, match=f"{next(iter(facts))} is .*, expected text"):
        decode_map(encode_map(small_map(), replace(FACTS, **facts)), "hall.map")


def test_what_no_covariance_can_be_is_refused() -> None:
    """Landmarks known exactly beside others: every step of the filter raised, and what it fell back on as well."""
    whole = small_map()
    orphans = replace(
        whole, parents=np.full_like(whole.parents, -1), covariances_m2=np.zeros_like(whole.covariances_m2)
    )
    mixed = whole.block_m2.copy()
    mixed[0, 1] = mixed[1, 0] = 2.0 * np.sqrt(mixed[0, 0] * mixed[1, 1])
    for spoilt in (
        replace(whole, residuals=np.full_like(whole.residuals, 5e-324)),
        replace(whole, residuals=-whole.residuals),
        orphans,
        replace(whole, block_m2=-whole.block_m2),
        replace(whole, block_m2=mixed),
    ):
        with pytest.raises(NotAMapError, match="a covariance in it is not valid"):
            decode_map(encode_map(spoilt, FACTS), "hall.map")


def test_a_joint_covariance_that_is_none_is_refused() -> None:
    """Two landmarks that contradict each other, each sound by itself: the filter broke down at the first scan."""
    whole = small_map()
    lopsided, indefinite = whole.block_m2.copy(), whole.block_m2.copy()
    lopsided[0, 2] += 0.5 * lopsided[0, 0]
    indefinite[0, 2] = indefinite[2, 0] = 3.0 * np.sqrt(indefinite[0, 0] * indefinite[2, 2])
    for block in (lopsided, indefinite):
        with pytest.raises(NotAMapError, match="the joint covariance in it is not valid"):
            decode_map(encode_map(replace(whole, block_m2=block), FACTS), "hall.map")


def test_rates_that_no_landmark_has_are_refused() -> None:
    """Found more often than in view: the score of the pose became NaN, and any pose was believed."""
    whole = small_map()
    looks, finds = whole.looks.copy(), whole.finds.copy()
    looks[0], finds[0] = 1e-13, 1.0
    for spoilt in (
        replace(whole, looks=looks, finds=finds),
        replace(whole, looks=-np.ones_like(looks)),
        replace(whole, finds=-np.ones_like(finds)),
        replace(whole, after_miss=np.array((5e-324, 8.0))),
        replace(whole, after_miss=np.zeros(2)),
    ):
        with pytest.raises(NotAMapError, match="found more often than it was in view"):
            decode_map(encode_map(spoilt, FACTS), "hall.map")


@pytest.mark.parametrize(
    ("key", "joint"),
    [("landmarks", small_map(60)), ("in_state", small_map(60, 30)), ("views", small_map(8))],
)
def test_a_map_with_more_than_any_drive_needs_is_refused(
    key: str, joint: JointMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, count = encode_map(joint, FACTS), {"landmarks": 60, "in_state": 30, "views": 2}[key]
    monkeypatch.setitem(map_file.MOST, key, count - 1)
    with pytest.raises(NotAMapError, match=rf"hall\.map has {count} .*, expected at most {count - 1}; save"):
        decode_map(data, "hall.map")
    with pytest.raises(NotAMapError, match=f"the map has {count}"):
        encode_map(joint, FACTS)


def test_landmarks_all_at_one_place_are_refused_with_the_place(monkeypatch: pytest.MonkeyPatch) -> None:
    count = map_file.MOST_IN_A_PATCH + 1
    heaped = replace(small_map(count), means_m=np.full((count, 2), -3.5))
    with monkeypatch.context() as patch:
        patch.setattr(map_file, "MOST_IN_A_PATCH", count)
        data = encode_map(heaped, FACTS)
    with pytest.raises(NotAMapError, match=f"{count} landmarks within 1 m of x -4 m, y -4 m, expected at most"):
        decode_map(data, "hall.map")


def test_a_map_with_as_much_in_it_as_is_allowed_fits_into_its_file() -> None:
    sizes = {"L": map_file.MOST["landmarks"], "S": 2 * map_file.MOST["in_state"], "K": map_file.MOST["views"]}
    arrays = sum(
        np.dtype(kind).itemsize * math.prod(sizes[size] if isinstance(size, str) else size for size in shape)
        for kind, shape in map_file.SHAPES.values()
    )
    assert arrays + map_file.MOST_HEADER_BYTES + 1024 < LARGEST_MAP_BYTES


def test_a_header_without_an_end_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    data = map_bytes()
    monkeypatch.setattr(map_file, "MOST_HEADER_BYTES", 100)
    with pytest.raises(NotAMapError, match="header that does not end within 100 bytes"):
        decode_map(data, "hall.map")
    with pytest.raises(NotAMapError, match="configuration and names of runs"):
        map_bytes()


def test_every_flipped_byte_is_noticed() -> None:
    data = map_bytes(6)
    for at in range(0, len(data), 7):
        spoilt = bytearray(data)
        spoilt[at] ^= 0x10
        with pytest.raises(NotAMapError, match=r"hall\.map (is|has|cannot)"):
            decode_map(bytes(spoilt), "hall.map")


def test_a_newer_format_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("runtime.map_files.map_file.FORMAT", 3)
        newer = map_bytes()
    with pytest.raises(NotAMapError, match="has format 3, but this release reads 2"):
        decode_map(newer, "hall.map")


@pytest.mark.parametrize(("landmarks", "why"), [(0, "holds no landmark"), (1, "holds one landmark")])
def test_a_map_too_small_to_find_a_pose_in_is_refused(landmarks: int, why: str, tmp_path: Path) -> None:
    (tmp_path / "hall.map").write_bytes(map_bytes(landmarks))
    with pytest.raises(NotAMapError, match=why):
        read_map(tmp_path / "hall.map")


def test_a_map_that_is_not_there_or_is_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotAMapError, match="does not exist"):
        read_map(tmp_path / "hall.map")
    with pytest.raises(NotAMapError, match="cannot be read"):
        read_map(tmp_path)


def test_a_map_is_never_overwritten_and_nothing_is_left_behind(tmp_path: Path) -> None:
    path = tmp_path / "hall.map"
    write_new_map(path, b"old")
    with pytest.raises(RunExistsError, match="never overwritten"):
        write_new_map(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_rovers_that_write_at_once_each_get_a_map_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "hall.map"
    path.write_bytes(b"read")
    written: list[Path] = []
    rovers = [threading.Thread(target=lambda k=k: written.append(write_successor(path, b"%d" % k))) for k in range(8)]
    for rover in rovers:
        rover.start()
    for rover in rovers:
        rover.join()
    assert sorted(written) == sorted(tmp_path / f"hall-{number}.map" for number in range(2, 10))
    assert sorted(each.read_bytes() for each in written) == [b"%d" % number for number in range(8)]
    assert path.read_bytes() == b"read"
    assert write_successor(tmp_path / "hall-4.map", b"") == tmp_path / "hall-10.map"


def test_a_full_disk_leaves_nothing_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(map_store, "atomic_write", full)
    with pytest.raises(StorageError, match="No space left on device"):
        write_new_map(tmp_path / "hall.map", b"new")
    assert list(tmp_path.iterdir()) == []


def test_a_card_without_hard_links_holds_maps_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_links(*_: object) -> None:
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", no_links)
    write_new_map(tmp_path / "hall.map", b"new")
    with pytest.raises(RunExistsError):
        write_new_map(tmp_path / "hall.map", b"other")
    assert [each.read_bytes() for each in tmp_path.iterdir()] == [b"new"]


def test_a_folder_that_may_not_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="cannot be written"):
        write_new_map(tmp_path / "absent" / "hall.map", b"new")


def test_arrays_that_do_not_fit_each_other_are_refused() -> None:
    joint = small_map()
    parents = joint.parents.copy()
    parents[20, 0] = 30
    wrong = small_map()
    object.__setattr__(wrong, "parents", parents)
    with pytest.raises(NotAMapError, match="refers to one that comes after it"):
        decode_map(encode_map(wrong, FACTS), "hall.map")
    nowhere = small_map()
    object.__setattr__(nowhere, "means_m", np.full_like(joint.means_m, np.nan))
    with pytest.raises(NotAMapError, match="not finite"):
        decode_map(encode_map(nowhere, FACTS), "hall.map")
