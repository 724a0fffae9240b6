"""What a command writes is whole, or nothing of it is left: a full disk, a defect or Ctrl-C leaves no half."""

import resource
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

import pytest
from typer.testing import CliRunner

from drivers.canbus.frame import CanFrame
from runtime.cli.__main__ import app
from runtime.errors import StorageError
from runtime.record.folder import RunFolder
from runtime.simulation.sent import SentBytes
from tests.runtime.record.test_segments import driven
from tests.support.runtime.recordings import FILES

WORDS: dict[str, Callable[[Path, Path], list[str]]] = {
    "replay": lambda source, out: ["replay", str(source / "run"), "--out", str(out)],
    "recover": lambda source, out: ["log", "recover", str(source / "run"), "--out", str(out)],
    "draw": lambda source, out: ["map", "draw", str(source / "run"), "--out", str(out)],
    "import": lambda source, out: ["import", str(source / "log"), "--out", str(out)],
    "ros2": lambda source, out: ["export", str(source / "run"), "--no-grid", "--ros2", str(out)],
    "csv": lambda source, out: [
        "export",
        str(source / "run"),
        "--csv",
        str(out / "a.csv"),
        "--tum",
        str(out / "a.tum"),
    ],
    "rclpy": lambda _source, out: ["bridge", "rclpy", "--out", str(out.parent.parent / "node.py")],
    "compare": lambda source, _out: ["compare", str(source / "run"), str(source / "run")],
}


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("source")
    driven(folder / "run")
    (folder / "log").write_bytes(FILES["carmen"])
    return folder


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """As a disk with little room: what would make a file larger is refused."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("room", [0, 200, 3000])
@pytest.mark.parametrize("name", WORDS)
def test_a_full_disk_leaves_nothing(source: Path, tmp_path: Path, name: str, room: int) -> None:
    before = {path: path.read_bytes() for path in source.rglob("*") if path.is_file()}
    with files_of_at_most(room):
        result = CliRunner().invoke(app, WORDS[name](source, tmp_path / "new" / "out"))
    left = list(tmp_path.rglob("*"))
    if result.exit_code == 0:  # small enough
        assert left
        return
    assert isinstance(result.exception, OSError | StorageError)  # both end with exit code 6
    assert left == []
    assert {path: path.read_bytes() for path in source.rglob("*") if path.is_file()} == before


def test_a_folder_that_was_there_stays_empty(source: Path, tmp_path: Path) -> None:
    for name in ("replay", "recover", "draw", "import", "ros2"):
        (out := tmp_path / name).mkdir()
        with files_of_at_most(200):
            assert CliRunner().invoke(app, WORDS[name](source, out)).exit_code != 0
        assert out.is_dir()
        assert not any(out.iterdir()), name


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError, StorageError, AssertionError])
def test_whatever_ends_it_takes_away_what_was_made_and_nothing_else(tmp_path: Path, error: type[BaseException]) -> None:
    folder = RunFolder.create(tmp_path / "a" / "b" / "run", tmp_path)
    folder.write_summary({})
    (tmp_path / "a" / "neighbour").mkdir()
    with pytest.raises(error), folder.whole_or_gone():
        raise error
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["neighbour"]


def test_a_simulation_that_cannot_be_recorded_ends_and_leaves_nothing(tmp_path: Path) -> None:
    stop = threading.Event()

    def recorded() -> None:
        with files_of_at_most(5000), SentBytes(tmp_path / "new" / "sent", stop) as sent:
            sent.laser(b"x")
            while not stop.is_set():
                sent.wheels(CanFrame(0, 0x181, Random(1).randbytes(8)))
            sent.laser(b"x")

    with pytest.raises(StorageError, match=r"sent cannot be written .*; what was recorded was removed"):
        recorded()
    assert list(tmp_path.iterdir()) == []
