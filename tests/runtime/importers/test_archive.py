"""An archive of arrays is taken with whatever optional part it lacks, and refused in one sentence otherwise."""

import io
import json
import os
import re
import shutil
import warnings
import zipfile
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.errors import DataSetError, InfantError
from runtime.importers.archive import load_archive
from runtime.importers.data_set import import_data_set
from runtime.record.reader import RunReader
from runtime.source_tree import CONFIG, ROOT
from tests.support.runtime.data_sets import META, POSES, SCANS, write_set

ROWS = len(POSES["odom_t"])
ODOMETRY: dict[str, dict[str, Any]] = {
    "pose": POSES,
    "scans alone": {"scan_odom_pose": np.zeros((3, 3))},
    "poses of both": POSES | {"scan_odom_pose": np.zeros((3, 3))},
    "differential": {"odom_t": POSES["odom_t"], "odom_ticks": np.zeros((ROWS, 2))},
    "rolled": {"odom_t": POSES["odom_t"], "odom_wheel": np.zeros((ROWS, 2))},
    "steered": {"odom_t": POSES["odom_t"], "odom_v": np.ones(ROWS), "odom_steer": np.zeros(ROWS)},
    "speed_yaw_rate": {"odom_t": POSES["odom_t"], "odom_v": np.ones(ROWS), "odom_w": np.zeros(ROWS)},
}
MODELS = {"scans alone": "pose", "poses of both": "pose", "rolled": "differential"}
SIGHTINGS: dict[str, Any] = {
    "obs_t": np.array([100.0, 100.0, 101.0]),
    "obs_id": np.array([7, 8, 9]),
    "obs_range": np.array([1.0, 2.0, 3.0]),
    "obs_bearing": np.zeros(3),
}
TRUTH: dict[str, Any] = {
    "gt_t": np.array([100.0, 101.0]),
    "gt_xy": np.zeros((2, 2)),
    "gt_theta": np.zeros(2),
    "gt_good": np.array([True, False]),
    "rel": np.zeros((4, 8)),
    "landmarks": np.ones((2, 2)),
    "landmark_id": np.array([7, 8]),
}
VALUES: tuple[Any, ...] = (
    0,
    -1,
    1.5,
    1e300,
    -1e18,
    4e9,
    float("nan"),
    float("inf"),
    "0.5",
    "",
    None,
    True,
    [1],
    {},
    "NaN",
)

TOLD = (*META, "vehicle", "geometry", "no_return", "t0_unix", "range_min", "time_increment", "gt_kind")


def config_for(folder: Path, kind: str) -> Path:
    path = folder / f"{kind}.toml"
    path.write_text(f"[vehicle]\nmotion_model = '{MODELS.get(kind, kind)}'\nmax_speed_mps = 30.0\n")
    return path


@pytest.mark.parametrize("kind", ODOMETRY)
def test_every_kind_of_odometry_is_imported(tmp_path: Path, kind: str) -> None:
    source = write_set(tmp_path / "set", SCANS | ODOMETRY[kind] | TRUTH, {"name": "yard"})
    result = import_data_set(source, tmp_path / "run", config_for(tmp_path, kind))
    assert (result["scans"], result["warnings"]) == (3, [])
    assert result["truth"] is not None


@pytest.mark.parametrize("absent", ["landmark_id", "gt_theta", "gt_good", "obs_id"])
def test_a_companion_array_may_be_absent(tmp_path: Path, absent: str) -> None:
    arrays = {name: array for name, array in (POSES | SIGHTINGS | TRUTH).items() if name != absent}
    source = write_set(tmp_path / "set", arrays, {"name": "yard"})
    result = import_data_set(source, tmp_path / "run", config_for(tmp_path, "pose"))
    assert (result["scans"], result["warnings"]) == (2, [])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"ranges": np.ones(3)}, r"ranges has the shape \(3,\), expected \(rows, beams\)"),
        ({"ranges": np.ones((2, 5))}, "ranges has 2 rows and scan_t has 3"),
        ({"ranges": np.full((3, 5), "1.0")}, "ranges holds <U3, expected numbers"),
        ({"ranges": np.ones((3, 0))}, "at least one beam"),
        ({"odom_pose": np.zeros((ROWS, 2))}, r"odom_pose has the shape \(32, 2\), expected \(rows, 3\)"),
        ({"odom_t": np.array(1.0)}, r"odom_t has the shape \(\), expected \(rows,\)"),
        ({"scan_t": np.array([1e18, 2e18, 3e18])}, r"scan_t\[0\] = 1e\+18, expected seconds"),
        ({"gt_t": np.zeros(2), "gt_xy": np.zeros((2, 3))}, r"gt_xy has the shape \(2, 3\), expected \(rows, 2\)"),
        ({"rel": np.zeros((4, 7))}, r"rel has the shape \(4, 7\), expected \(rows, 8\)"),
        ({"landmarks": np.zeros((2, 3))}, r"landmarks has the shape \(2, 3\)"),
        ({"ranges": np.array([[None] * 5] * 3)}, "array ranges cannot be read; expected plain numbers"),
    ],
)
def test_a_wrong_shape_is_named_in_one_sentence(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    source = write_set(tmp_path / "set", SCANS | POSES | changes, {"name": "yard"})
    with pytest.raises(DataSetError, match=said) as caught:
        import_data_set(source, tmp_path / "run", config_for(tmp_path, "pose"))
    assert "\n" not in str(caught.value)
    assert "pickle" not in str(caught.value)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("meta", "said"),
    [
        ({"range_max": None}, "range_max = None, expected a number from 0.001"),
        ({"angle_increment": 0.0}, "spans 0 deg"),
        ({"angle_increment": 5.0}, "expected radians"),
        ({"no_return": ">= far"}, "no_return = '>= far', expected something like"),
        ({"t0_unix": "today"}, "t0_unix = 'today', expected a number"),
    ],
)
def test_a_description_that_cannot_be_is_named(tmp_path: Path, meta: dict[str, Any], said: str) -> None:
    source = write_set(tmp_path / "set", SCANS | POSES, {"name": "yard"} | meta)
    with pytest.raises(DataSetError, match=said):
        import_data_set(source, tmp_path / "run", config_for(tmp_path, "pose"))
    assert not (tmp_path / "run").exists()


def test_rows_that_say_nothing_are_left_out_and_counted(tmp_path: Path) -> None:
    times_s = POSES["odom_t"].copy()
    times_s[3:6] = (np.nan, np.inf, times_s[20])
    poses = POSES["odom_pose"].copy()
    poses[9, 1] = np.nan
    source = write_set(tmp_path / "set", SCANS | {"odom_t": times_s, "odom_pose": poses}, {"name": "yard"})
    result = import_data_set(source, tmp_path / "run", config_for(tmp_path, "pose"))
    assert result["wheel_samples"] == ROWS - 4
    assert result["warnings"] == [
        "2 of 32 odometry samples left out: odom_t is not a time in seconds (first: odom_t[3])",
        "1 of 32 odometry samples left out: odom_pose is not a finite number (first: odom_pose[9])",
        "1 of 32 odometry samples left out: odom_t does not increase there (first: odom_t[5])",
    ]


def test_a_truth_without_times_is_left_out_and_said(tmp_path: Path) -> None:
    source = write_set(tmp_path / "set", SCANS | POSES | {"gt_xy": np.zeros((2, 2))}, {"name": "yard"})
    result = import_data_set(source, tmp_path / "run", config_for(tmp_path, "pose"))
    assert result["truth"] is None
    assert result["warnings"] == ["the truth is left out: gt_xy has no times (array gt_t)"]


def test_a_sensor_that_stood_still_needs_no_odometry(tmp_path: Path) -> None:
    source = write_set(tmp_path / "set", SCANS, {"name": "yard"})
    with pytest.raises(DataSetError, match="--at-rest"):
        import_data_set(source, tmp_path / "run", config_for(tmp_path, "pose"))
    for kind in ("pose", "differential", "steered", "speed_yaw_rate"):
        result = import_data_set(source, tmp_path / kind, config_for(tmp_path, kind), at_rest=True)
        recorded = [again.tick for again in RunReader(tmp_path / kind).ticks()]
        assert (result["scans"], len(recorded)) == (3, result["ticks"])
        assert all(tick.wheels for tick in recorded)


@pytest.mark.parametrize("text", ["{", "[1]", '"yard"', "", "nul", "[" * 100_000])
def test_a_description_that_is_no_table_is_refused(tmp_path: Path, text: str) -> None:
    source = write_set(tmp_path / "set", SCANS | POSES)
    (source / "meta.json").write_text(text)
    with pytest.raises(DataSetError, match=r"meta\.json") as caught:
        load_archive(source)
    assert "\n" not in str(caught.value)


def test_the_only_archive_of_a_folder_is_found_whatever_its_name(tmp_path: Path) -> None:
    write_set(tmp_path / "set", SCANS | POSES).rename(tmp_path / "renamed")
    assert load_archive(tmp_path / "renamed").path.name == "set.npz"


def changed(array: Any, how: str, seed: int) -> Any:
    """The array in another form, or with other values in it."""
    rng = np.random.default_rng(seed)
    array = np.array(array)
    match how:
        case "transposed":
            return array.T
        case "deeper":
            return array[np.newaxis]
        case "flat":
            return array.reshape(-1)
        case "single":
            return array.reshape(-1)[0]
        case "shorter":
            return array[:-1]
        case "empty":
            return array[:0]
        case "narrow":
            return array[..., :0]
        case "backwards":
            return array[::-1]
        case "text":
            return array.astype(str)
        case "complex":
            return array.astype(complex)
        case "whole":
            return np.nan_to_num(array).clip(-100, 100).astype(np.int8)
        case "truth":
            return array.astype(bool)
        case "objects":
            return array.astype(object)
        case "dates":
            return np.full(array.shape, "2026-01-01", "datetime64[s]")
    values = array.astype(np.float64)
    where = rng.random(values.shape) < 0.3
    values[where] = {"nan": np.nan, "inf": np.inf, "huge": 1e300, "minus": -1e19}[how]
    return values


HOWS = (
    *("transposed", "deeper", "flat", "single", "shorter", "empty", "narrow", "backwards", "text", "complex"),
    *("whole", "truth", "objects", "dates", "nan", "inf", "huge", "minus"),
)


def outcome(folder: Path, kind: str) -> tuple[dict[str, Any] | None, Exception | None]:
    try:
        return import_data_set(folder / "set", folder / "run", config_for(folder, kind)), None
    except Exception as error:  # noqa: BLE001 what kind it is, is the question
        return None, error


@given(
    st.sampled_from(sorted(ODOMETRY)),
    st.booleans(),
    st.lists(st.tuples(st.integers(0, 30), st.sampled_from(HOWS)), max_size=3),
    st.sets(st.integers(0, 30), max_size=3),
    st.lists(st.tuples(st.sampled_from(TOLD), st.sampled_from(VALUES)), max_size=2),
    st.integers(0, 99),
)
def test_whatever_the_arrays_are_the_answer_is_a_run_or_one_sentence(
    kind: str,
    sighted: bool,
    changes: list[tuple[int, str]],
    absent: set[int],
    told: list[tuple[str, Any]],
    seed: int,
) -> None:
    whole = (SIGHTINGS if sighted else SCANS) | ODOMETRY[kind] | TRUTH
    arrays, names = dict(whole), sorted(whole)
    for number, how in changes:
        name = names[number % len(names)]
        arrays[name] = changed(whole[name], how, seed)
    kept = {name: array for k, (name, array) in enumerate(sorted(arrays.items())) if k not in absent}
    folder = Path(mkdtemp())
    try:
        meta = META | {"name": "yard"} | dict(told)
        (folder / "set").mkdir()
        np.savez(folder / "set" / "set.npz", meta=np.array(json.dumps(meta)), **kept)
        result, error = outcome(folder, kind)
        if result is None:
            assert isinstance(error, InfantError), repr(error)
            assert (error.exit_code, "\n" in str(error)) == (3, False)
            assert not (folder / "run").exists()
        else:
            recorded = [again.tick for again in RunReader(folder / "run").ticks()]
            assert len(recorded) == result["ticks"]
            assert sum(tick.scan is not None for tick in recorded) == result["scans"] > 0
    finally:
        shutil.rmtree(folder)


@pytest.mark.parametrize(
    ("name", "descr", "why"),
    [("scan_t", "<f8", "unpacks to 134 MB, expected at most"), ("meta", "<U1", "a description has at most")],
)
def test_an_archive_of_nothing_but_zeros_is_refused_before_it_is_unpacked(
    tmp_path: Path, name: str, descr: str, why: str
) -> None:
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": descr, "fortran_order": False, "shape": (1 << 24,)})
    with zipfile.ZipFile(tmp_path / "set.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(f"{name}.npy", head.getvalue() + bytes((1 << 24) * np.dtype(descr).itemsize))
    with pytest.raises(DataSetError, match=why):
        load_archive(tmp_path / "set.npz")


def test_a_description_that_is_a_pipe_is_refused(tmp_path: Path) -> None:
    path = write_set(tmp_path / "set", SCANS | POSES, {"name": "set"})
    (path / "meta.json").unlink(missing_ok=True)
    os.mkfifo(path / "meta.json")
    load_archive(path)  # which is not looked at: it is no file


@pytest.mark.parametrize("head", [b"(" * 5000, b"(", b'{\'descr\': """', b"9" * 5000])
def test_an_array_whose_head_is_no_python_is_refused(tmp_path: Path, head: bytes) -> None:
    with zipfile.ZipFile(tmp_path / "set.npz", "w") as archive:
        archive.writestr("scan_t.npy", np.lib.format.magic(1, 0) + len(head).to_bytes(2, "little") + head)
    with pytest.raises(DataSetError, match="scan_t cannot be read"):
        load_archive(tmp_path / "set.npz")


def archive_of(path: Path, names: list[str], packing: int = zipfile.ZIP_STORED) -> Path:
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (1 << 78, 4)})
    with warnings.catch_warnings(), zipfile.ZipFile(path, "w", packing) as archive:
        warnings.simplefilter("ignore")  # that names come twice
        for name in names:
            archive.writestr(f"{name}.npy", head.getvalue())
    return path


@pytest.mark.parametrize(
    ("names", "packing", "why"),
    [
        (["scan_t"], zipfile.ZIP_STORED, "scan_t cannot be read"),
        (["scan_t"] * 2, zipfile.ZIP_STORED, "a duplicate name"),
        (["scan_t"], zipfile.ZIP_LZMA, "not packed by numpy"),
        ([f"x{k}" for k in range(6000)], zipfile.ZIP_STORED, "list of contents is longer"),
    ],
)
def test_an_archive_that_numpy_would_not_have_written_is_refused(
    tmp_path: Path, names: list[str], packing: int, why: str
) -> None:
    with pytest.raises(DataSetError, match=why):
        load_archive(archive_of(tmp_path / "set.npz", names, packing))


NOISY = np.tile(np.random.default_rng(1).integers(0, 4, (20_000, 20), np.uint8), (1, 35))  # packs to a fiftieth


@pytest.mark.parametrize(
    ("arrays", "told"),
    [
        ({"odom_t": 0.01 * np.arange(300_000), "odom_pose": np.zeros((300_000, 3))}, "rows with a time"),
        ({"scan_t": 0.01 * np.arange(200_000), "ranges": np.ones((200_000, 4), np.float32)}, "rows with a time"),
        ({"scan_t": 0.1 * np.arange(20_000), "ranges": NOISY}, "beams"),
    ],
)
def test_more_rows_or_beams_than_so_few_bytes_hold_of_a_recording_are_refused(
    tmp_path: Path, arrays: dict[str, Any], told: str
) -> None:
    np.savez_compressed(tmp_path / "set.npz", meta=np.array(json.dumps(META)), **(SCANS | POSES | arrays))
    with pytest.raises(DataSetError, match=rf"holds \d+ {told}, expected at most \d+ in \d+ bytes"):
        load_archive(tmp_path / "set.npz")


def test_the_arrays_that_the_page_makes_of_a_csv_become_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    block = re.search(
        r"^```python\n(.*?)^```$", (ROOT / "docs/data_sets.md").read_text("utf-8"), re.MULTILINE | re.DOTALL
    )
    assert block is not None
    exec(compile(block[1], "docs/data_sets.md", "exec"), {})  # noqa: S102 our own page
    result = import_data_set(tmp_path / "yard.npz", tmp_path / "run", CONFIG / "carmen.toml")
    assert (result["scans"], result["wheel_samples"], result["mount"]["x_m"]) == (200, 200, 0.2)
