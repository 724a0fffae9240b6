import os
import socket
from pathlib import Path

import pytest

from runtime.atomic_write import acting_as_owner, atomic_write, replacement
from runtime.errors import UsageError
from runtime.record.folder import RunFolder
from runtime.record.manifest import Manifest
from runtime.report.compare import build_comparison
from runtime.setup.install import FileState, Plan, PlannedFile, apply

PREDICTABLE = ("{}.unfinished", ".{}.unfinished", "{}.partial", "{}.tmp")


def planted(folder: Path, name: str) -> Path:
    """Links to another's file under the name itself and every name that earlier releases wrote to first."""
    victim = folder.parent / "victim"
    victim.write_text("untouched")
    for link in (name, *(pattern.format(name) for pattern in PREDICTABLE), Path(name).stem + ".unfinished"):
        (folder / link).symlink_to(victim)
    return victim


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "run"
    path.mkdir()
    return path


def write_manifest(folder: Path) -> Path:
    manifest = Manifest(folder / "manifest.jsonl")
    manifest.add("run", created_utc="")
    manifest.save()
    return manifest.path


def write_summary(folder: Path) -> Path:
    RunFolder(folder).write_summary({"ticks": 3})
    return folder / "summary.json"


def install_file(folder: Path) -> Path:
    path = folder / "infant.service"
    apply(Plan((PlannedFile(path, "[Unit]\n", FileState.DIFFERS),), ()), lambda command: None)
    return path


@pytest.mark.parametrize("write", [write_manifest, write_summary, install_file])
def test_no_planted_link_is_followed(folder: Path, write: object) -> None:
    assert callable(write)
    name = write(folder).name
    (folder / name).unlink()
    victim = planted(folder, name)
    path = write(folder)
    assert victim.read_text() == "untouched"
    assert path.is_file()
    assert not path.is_symlink()


def test_the_new_content_has_the_name_and_nothing_else_is_left(folder: Path) -> None:
    path = folder / "map.json"
    path.write_text("old")
    atomic_write(path, "new, with µ")
    atomic_write(folder / "bytes", b"\0\1", mode=0o600)
    assert path.read_text(encoding="utf-8") == "new, with µ"
    assert (folder / "bytes").stat().st_mode & 0o777 == 0o600
    assert sorted(os.listdir(folder)) == ["bytes", "map.json"]


def test_the_umask_decides_who_may_read(folder: Path) -> None:
    before = os.umask(0o027)
    try:
        atomic_write(folder / "map.json", "")
    finally:
        os.umask(before)
    assert (folder / "map.json").stat().st_mode & 0o777 == 0o640


def test_a_refusal_leaves_the_old_content_and_no_other_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = folder / "map.json"
    path.write_text("old")

    def refuse(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(OSError, match="No space"):
        atomic_write(path, "new")
    assert path.read_text() == "old"
    assert os.listdir(folder) == ["map.json"]


def test_a_library_that_fails_leaves_the_old_file(folder: Path) -> None:
    path = folder / "review.rrd"
    path.write_text("old")

    def half_written() -> None:
        with replacement(path) as unfinished:
            unfinished.write_text("half")
            raise RuntimeError("the library gave up")

    with pytest.raises(RuntimeError, match="gave up"):
        half_written()
    assert path.read_text() == "old"
    assert os.listdir(folder) == ["review.rrd"]


def test_the_name_is_synced_after_the_content(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A loss of power between the two must not leave a name without content."""
    steps: list[str] = []
    sync, rename = os.fsync, os.replace

    def noted_sync(descriptor: int) -> None:
        steps.append(os.readlink(f"/proc/self/fd/{descriptor}"))
        sync(descriptor)

    def noted_rename(source: str, target: str, **folders: int) -> None:
        steps.append("rename")
        rename(source, target, **folders)

    monkeypatch.setattr(os, "fsync", noted_sync)
    monkeypatch.setattr(os, "replace", noted_rename)
    atomic_write(folder / "map.json", "new")
    assert steps[0].endswith(".unfinished")
    assert steps[1:] == ["rename", str(folder)]


NOBODY = 65534


@pytest.fixture
def of_nobody(folder: Path) -> Path:
    """A folder of another user, in which root writes; what that user may not write to stays as it is."""
    if os.geteuid() != 0:
        pytest.skip("only root can make a folder of another user")
    folder.parent.chmod(0o755)
    for above in folder.parents:
        if above.stat().st_mode & 0o011 != 0o011:
            above.chmod(above.stat().st_mode | 0o011)
    os.chown(folder, NOBODY, NOBODY)
    return folder


def test_root_writes_into_the_folder_of_another_user_as_that_user(of_nobody: Path) -> None:
    atomic_write(of_nobody / "map.json", "new")
    with replacement(of_nobody / "review.rrd") as unfinished:
        assert unfinished.parent != of_nobody  # a library's threads would follow links there as root
        unfinished.write_text("drawn")
    made = RunFolder.create(of_nobody / "replays" / "one", of_nobody)
    for path in (of_nobody / "map.json", of_nobody / "review.rrd", made.path):
        assert path.stat().st_uid == NOBODY
    assert (of_nobody / "review.rrd").read_text() == "drawn"
    (folder := of_nobody.parent / "mine").mkdir()
    atomic_write(folder / "file", "")  # and is root again
    assert (folder / "file").stat().st_uid == 0


def test_root_has_no_more_rights_there_than_that_user(of_nobody: Path) -> None:
    of_nobody.chmod(0o500)
    with pytest.raises(PermissionError):
        atomic_write(of_nobody / "map.json", "new")
    with acting_as_owner(of_nobody), pytest.raises(PermissionError):
        (of_nobody.parent / "elsewhere").write_text("as nobody")


def test_a_library_gets_a_name_in_utf_8_whatever_the_folder_is_called(tmp_path: Path) -> None:
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/b\xe4d"))
    folder.mkdir()
    with replacement(folder / "review.rrd") as unfinished:
        str(unfinished).encode()
        unfinished.write_text("drawn")
    atomic_write(folder / "report.html", f"of {folder.name}")
    assert (folder / "review.rrd").read_text() == "drawn"
    assert (folder / "report.html").read_text() == "of b\\udce4d"
    assert len(os.listdir(folder)) == 2


def test_no_file_takes_the_place_of_a_device_a_pipe_or_a_link_to_one(folder: Path) -> None:
    """As root, `infant compare A B --out /dev/null` put a page where every program of the machine writes to."""
    os.mkfifo(folder / "pipe")
    (folder / "stdout").symlink_to("/proc/self/fd/1")
    (folder / "null").symlink_to("/dev/null")
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(folder / "socket"))
        for name in ("pipe", "stdout", "null", "socket"):
            before = os.lstat(folder / name)
            with pytest.raises(OSError, match="a device or a pipe, which no file may replace"):
                atomic_write(folder / name, "new")
            with (
                pytest.raises(OSError, match="a device or a pipe, which no file may replace"),
                replacement(folder / name) as path,
            ):
                path.write_text("new")
            assert os.lstat(folder / name).st_ino == before.st_ino
    assert len(list(folder.iterdir())) == 4


@pytest.mark.parametrize("name", [".", "/", "report.json"])
def test_a_page_without_a_name_of_its_own_is_refused_before_the_work(name: str) -> None:
    with pytest.raises(UsageError, match="expected the name of an HTML file"):
        build_comparison(Path("nothing"), Path("nothing"), Path(name))
