"""A replay proves something of a run only where the run is what was closed; one that was killed is what it is."""

from pathlib import Path

from runtime.record.check import alterations_of
from runtime.record.folder import RunFolder
from runtime.record.reader import RunReader
from tests.runtime.record.test_check import killed
from tests.runtime.record.test_segments import driven


def altered(folder: RunFolder) -> list[str]:
    reader = RunReader(folder.path)
    for _ in reader.ticks():
        pass
    return alterations_of(reader)


def spoil(path: Path, at: int, size: int = 64) -> None:
    path.chmod(0o644)
    content = bytearray(path.read_bytes())
    content[at : at + size] = bytes(byte ^ 255 for byte in content[at : at + size])
    path.write_bytes(content)


def test_a_whole_run_and_one_that_was_killed_are_as_they_were_left(tmp_path: Path) -> None:
    assert altered(driven(tmp_path / "whole")) == []
    folder = killed(tmp_path / "killed")
    assert altered(folder) == []
    content = folder.mcap_path.read_bytes()
    folder.mcap_path.write_bytes(content[:-7])  # within the last record
    assert altered(folder) == []


def test_changed_bytes_are_named_wherever_they_are(tmp_path: Path) -> None:
    for number, place in enumerate((0.3, 0.6, 0.99)):
        folder = driven(tmp_path / f"run{number}")
        spoil(folder.closed_path(2), int(place * folder.closed_path(2).stat().st_size))
        assert "run-0002.mcap is not as it was when it was closed" in altered(folder)[0]


def test_what_is_cut_off_or_gone_though_it_was_closed_is_named(tmp_path: Path) -> None:
    folder = driven(tmp_path / "cut")
    folder.mcap_path.chmod(0o644)
    folder.mcap_path.write_bytes(folder.mcap_path.read_bytes()[:-500])
    assert "run.mcap is not as it was when it was closed" in altered(folder)[0]
    folder = driven(tmp_path / "gone")
    folder.closed_path(2).unlink()
    assert "run-0002.mcap is missing" in altered(folder)[0]


def test_changed_bytes_of_a_run_that_was_killed_are_named(tmp_path: Path) -> None:
    folder = killed(tmp_path / "killed")
    spoil(folder.mcap_path, folder.mcap_path.stat().st_size // 2, 4)
    assert altered(folder)
