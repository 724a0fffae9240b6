"""Lines of a log come out whole, whatever was done to the file's end."""

import gzip
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.importers.parsing import text_lines
from runtime.importers.parsing.text_lines import FREE_LINES, TextLines


def read(path: Path, data: bytes) -> tuple[list[tuple[int, str, bool]], str]:
    path.write_bytes(data)
    lines = TextLines(path)
    return list(lines), lines.damage


def test_a_plain_file_and_a_compressed_one_hold_the_same(tmp_path: Path) -> None:
    text = b"one\ntw\xf6\nthree"
    wanted = [(1, "one", True), (2, "tw\u00f6", True), (3, "three", False)]
    assert read(tmp_path / "a", text) == (wanted, "")
    assert read(tmp_path / "a", gzip.compress(text, mtime=0)) == (wanted, "")


def test_members_behind_each_other_are_one_text(tmp_path: Path) -> None:
    packed = gzip.compress(b"one\nt", mtime=0) + gzip.compress(b"wo\n", mtime=0) + b"\0" * 512
    assert read(tmp_path / "a", packed) == ([(1, "one", True), (2, "two", True)], "")


@pytest.mark.parametrize("empty", [b"", gzip.compress(b"", mtime=0)])
def test_an_empty_file_has_no_line(tmp_path: Path, empty: bytes) -> None:
    assert read(tmp_path / "a", empty) == ([], "")


@given(st.data())
def test_a_part_of_a_compressed_file_gives_the_head_of_its_text(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    text = b"".join(b"%d\n" % (k * k * 7919) for k in range(20_000))
    packed = gzip.compress(text, mtime=0)
    kept = data.draw(st.integers(2, len(packed) - 1))
    lines, damage = read(tmp_path_factory.getbasetemp() / "part.gz", packed[:kept])
    assert damage
    assert text.startswith("".join(line + "\n" * is_whole for _, line, is_whole in lines).encode())


def test_a_damaged_middle_ends_the_text_there(tmp_path: Path) -> None:
    packed = bytearray(gzip.compress(b"".join(b"%d\n" % (k * k) for k in range(50_000)), mtime=0))
    packed[len(packed) // 2] ^= 0xFF
    lines, damage = read(tmp_path / "a", bytes(packed))
    assert "damaged" in damage
    assert 0 < len(lines) < 50_000 or "incorrect data check" in damage


def test_a_file_that_unpacks_to_a_thousand_times_its_size_is_left_in_little_memory(tmp_path: Path) -> None:
    data = gzip.compress((b" " * 1023 + b"\n") * (1 << 16))
    (tmp_path / "log.gz").write_bytes(data)
    lines = TextLines(tmp_path / "log.gz")
    tracemalloc.start()
    count = sum(1 for _ in lines)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0 < count < 1 << 15
    assert "more than 50 times their size" in lines.damage
    assert peak < 10 << 20


def test_short_lines_that_pack_to_nothing_are_not_read_by_the_million(tmp_path: Path) -> None:
    """A megabyte of them took a minute and a gigabyte; lines of a bus differ in their times at least."""
    (tmp_path / "a.gz").write_bytes(gzip.compress(b"(1) c 201#\n" * 400_000, mtime=0))
    lines = TextLines(tmp_path / "a.gz")
    assert 0 < sum(1 for _ in lines) <= FREE_LINES + 20_000
    assert "less than 2 bytes each" in lines.damage


def test_a_log_of_frames_at_an_exact_rate_is_read_to_its_end(tmp_path: Path) -> None:
    text = b"".join(b"(%d.%06d) can0 201#%016X\n" % (n // 1000, n % 1000 * 1000, n) for n in range(2 * FREE_LINES))
    (tmp_path / "a.gz").write_bytes(gzip.compress(text, mtime=0))
    lines = TextLines(tmp_path / "a.gz")
    assert sum(1 for _ in lines) == 2 * FREE_LINES
    assert not lines.damage


def test_a_log_of_more_lines_than_fit_is_read_up_to_the_bound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text_lines, "MOST_LINES", 5)
    lines, damage = read(tmp_path / "a", b"x\n" * 9)
    assert [number for number, _, _ in lines] == [1, 2, 3, 4, 5]
    assert damage == "what follows line 5 is more than fits into one run; split the log there"


def test_a_log_whose_lines_fill_the_memory_is_read_up_to_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text_lines, "MOST_KEPT_BYTES", 100)
    (tmp_path / "a").write_bytes(b"x\n" * 9)
    lines = TextLines(tmp_path / "a")
    for _ in lines:
        lines.keep(40)
    assert lines.damage == "what follows line 3 is more than fits into one run; split the log there"
