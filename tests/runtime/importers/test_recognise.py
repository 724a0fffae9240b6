"""A recording is known by what it holds; whatever a file holds, the answer is a run or one sentence."""

import os
import shutil
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.errors import DataSetError, InfantError, UsageError
from runtime.importers.data_set import import_data_set
from runtime.importers.recognise import load
from runtime.importers.rosbag import Topics
from runtime.record.reader import RunReader
from tests.support.examples import examples
from tests.support.runtime.recordings import FILES


@pytest.mark.parametrize("kind", FILES)
def test_a_recording_is_known_whatever_its_name_is(tmp_path: Path, kind: str) -> None:
    (tmp_path / "recording").write_bytes(FILES[kind])
    archive = load(tmp_path / "recording", Topics(), None)
    assert {"scan_t", "odom_t"} & archive.arrays.keys() or archive.raw is not None


def outcome(source: Path, run: Path, at_rest: bool) -> tuple[dict[str, Any] | None, Exception | None]:
    try:
        return import_data_set(source, run, at_rest=at_rest), None
    except Exception as error:  # noqa: BLE001 what kind it is, is the question
        return None, error


@examples(300)
@given(st.sampled_from(sorted(FILES)), st.data(), st.booleans())
def test_any_damage_gives_a_run_or_one_sentence(kind: str, data: st.DataObject, at_rest: bool) -> None:
    content = bytearray(FILES[kind])
    rng = np.random.default_rng(data.draw(st.integers(0, 10**6)))
    for _ in range(data.draw(st.integers(0, 6))):
        place = int(rng.integers(len(content)))
        match data.draw(st.sampled_from(("flip", "digit", "cut", "drop", "twice", "word"))):
            case "flip":
                content[place] ^= int(rng.integers(1, 256))
            case "digit":
                content[place] = ord("0") + int(rng.integers(10))
            case "cut":
                del content[place:]
            case "drop":
                del content[place : place + int(rng.integers(1, 300))]
            case "twice":
                content[place:place] = content[max(0, place - 200) : place]
            case "word":
                content[place:place] = (b" nan ", b" -1 ", b" 1e999 ", b"\n", b" inf ")[int(rng.integers(5))]
        content = content or bytearray(b"\0")
    folder = Path(mkdtemp())
    try:
        (folder / "recording").write_bytes(content)
        result, error = outcome(folder / "recording", folder / "run", at_rest)
        if result is None:
            assert isinstance(error, InfantError), repr(error)
            assert (error.exit_code, "\n" in str(error)) == (3, False)
            assert not (folder / "run").exists()
        else:
            assert sum(1 for _ in RunReader(folder / "run").ticks()) == result["ticks"]
    finally:
        shutil.rmtree(folder)


def test_what_is_neither_file_nor_folder_is_named(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name, said in (
        ("pipe", "is neither a file nor a folder"),
        ("nowhere", "does not exist"),
        ("n" * 300, "cannot be read"),
    ):
        with pytest.raises(DataSetError, match=said):
            load(tmp_path / name, Topics(), None)


def test_a_folder_of_other_files_lists_them(tmp_path: Path) -> None:
    (tmp_path / "drive.log").write_bytes(FILES["carmen"])
    with pytest.raises(DataSetError, match=r"it holds drive\.log; give .*the file of the recording"):
        load(tmp_path, Topics(), None)


def test_topics_of_what_is_no_bag_are_refused(tmp_path: Path) -> None:
    (tmp_path / "drive.log").write_bytes(FILES["carmen"])
    with pytest.raises(UsageError, match="--scan-topic and --odom-topic choose a topic of a ROS bag"):
        load(tmp_path / "drive.log", Topics("/scan"), None)
