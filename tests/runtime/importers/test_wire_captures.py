"""Captures of a rover's wires become runs: the bytes, and what they measured."""

import math
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from drivers.canbus.frame import CanFrame
from drivers.measurements import Scan, WheelCounts
from runtime.errors import DataSetError
from runtime.importers.data_set import import_data_set
from runtime.importers.parsing import scip_capture, text_lines
from runtime.importers.parsing.candump_lines import FRAME_BYTES, FrameColumns
from runtime.importers.wire_captures import load_candump, load_scip
from runtime.record.reader import RunReader
from runtime.replay.replay import replay_run
from runtime.settings.configuration import load_configuration
from runtime.source_tree import CONFIG
from tests.support.runtime.carmen_logs import moments, room_ranges
from tests.support.runtime.scip_captures import as_records, described, scan_messages


def scans_of(run: Path) -> list[Scan]:
    return [again.tick.scan for again in RunReader(run).ticks() if isinstance(again.tick.scan, Scan)]


@pytest.mark.parametrize("form", [as_records, b"".join], ids=["records", "bytes alone"])
def test_every_scan_of_a_capture_is_imported(tmp_path: Path, form: Callable[[list[bytes]], bytes]) -> None:
    (tmp_path / "a.logr").write_bytes(form([described(), *scan_messages(20)]))
    result = import_data_set(tmp_path / "a.logr", tmp_path / "run", at_rest=True)
    assert (result["scans"], result["warnings"]) == (20, [])
    scans = scans_of(tmp_path / "run")
    assert math.degrees(scans[0].bearings_rad[0]) == pytest.approx(-135.0)
    np.testing.assert_allclose(
        scans[3].ranges_m, room_ranges(list(moments(4))[3], 1081, -0.75 * math.pi, math.radians(0.25)), atol=6e-4
    )
    assert np.diff([scan.stamp_ns for scan in scans]) == pytest.approx(1e8, abs=3e6)
    kept = b"".join(
        bytes(record.data) for record in RunReader(tmp_path / "run").records() if record.topic == "/raw/laser"
    )
    assert scan_messages(1)[0] in kept


def test_a_capture_of_the_laser_alone_says_that_nobody_knows_the_motion(tmp_path: Path) -> None:
    (tmp_path / "a.logr").write_bytes(as_records([described(), *scan_messages(5)]))
    result = import_data_set(tmp_path / "a.logr", tmp_path / "run")
    assert (result["scans"], result["wheel_samples"]) == (5, 0)
    assert "give --at-rest" in result["warnings"][0]
    assert replay_run(tmp_path / "run", None, None, False, {})["scans"] == 5


def test_damaged_scans_are_counted(tmp_path: Path) -> None:
    messages = scan_messages(20)
    messages[7] = messages[7].replace(b"0", b"1", 400)
    messages[9] = messages[9][:1500] + b"\n\n"
    (tmp_path / "a.logr").write_bytes(as_records([described(), *messages, b"MD0000"]))
    result = import_data_set(tmp_path / "a.logr", tmp_path / "run", at_rest=True)
    assert result["scans"] == 18
    assert sum("of 20 scans left out" in warning for warning in result["warnings"]) >= 1
    assert any("6 bytes of a.logr are an incomplete message" in note for note in result["notes"])


def test_a_capture_without_the_lasers_description_says_what_it_is_taken_for(tmp_path: Path) -> None:
    (tmp_path / "a.logr").write_bytes(as_records(scan_messages(5)))
    result = import_data_set(tmp_path / "a.logr", tmp_path / "run", at_rest=True)
    assert result["scans"] == 5
    assert "assumed to be those of a UTM-30LX" in result["warnings"][0]


def test_a_capture_without_a_scan_keeps_its_bytes_and_says_so(tmp_path: Path) -> None:
    (tmp_path / "a.logr").write_bytes(b"QT\n00P\n\n")
    result = import_data_set(tmp_path / "a.logr", tmp_path / "run")
    assert result["warnings"] == ["a.logr holds no scan: none of its 1 messages is one"]
    assert [record.topic for record in RunReader(tmp_path / "run").records()] == ["/raw/laser"]


def test_the_capture_of_a_real_laser_is_imported(recorded_data: Callable[[str], Path], tmp_path: Path) -> None:
    source = recorded_data("scip_capture_utm30lx") / "example_utm_30lx.logr"
    assert import_data_set(source, tmp_path / "run", at_rest=True)["scans"] == 1
    assert scans_of(tmp_path / "run")[0].ranges_m.shape == (1081,)


def test_a_recorded_drive_of_the_rovers_own_wheels_is_imported(
    recorded_data: Callable[[str], Path], tmp_path: Path
) -> None:
    source = recorded_data("can_encoder") / "infant_candump.log"
    result = import_data_set(source, tmp_path / "run")
    assert (result["wheel_samples"], result["warnings"]) == (500, [])
    ticks = [again.tick for again in RunReader(tmp_path / "run").ticks()]
    samples = [sample for tick in ticks for sample in tick.wheels]
    assert all(isinstance(sample, WheelCounts) and sample.valid for sample in samples)
    lines = source.read_text().splitlines()
    assert sum(record.topic == "/raw/can" for record in RunReader(tmp_path / "run").records()) == len(lines)


def test_a_folder_with_both_wires_of_one_session_becomes_one_drive(
    recorded_data: Callable[[str], Path], tmp_path: Path
) -> None:
    folder = tmp_path / "session"
    folder.mkdir()
    (folder / "laser.logr").write_bytes(as_records([described(), *scan_messages(20)]))
    (folder / "wheels.candump").write_bytes((recorded_data("can_encoder") / "infant_candump.log").read_bytes())
    (folder / "notes.txt").write_text("a sunny day\n")
    result = import_data_set(folder, tmp_path / "run")
    assert (result["source"], result["scans"], result["wheel_samples"]) == ("wires session", 20, 500)
    assert result["warnings"] == []
    records = list(RunReader(tmp_path / "run").records())
    raw_ns = [record.stamp_ns for record in records if record.topic in ("/raw/laser", "/raw/can")]
    assert {"/raw/laser", "/raw/can"} <= {record.topic for record in records}
    assert raw_ns == sorted(raw_ns)
    assert raw_ns[0] < 2e9, "since the start of the drive and not since 1970"
    assert replay_run(tmp_path / "run", None, None, False, {})["scans"] == 20
    (folder / "laser.logr").unlink()
    assert import_data_set(folder, tmp_path / "wheels")["scans"] == 0
    (folder / "again.candump").write_bytes((folder / "wheels.candump").read_bytes())
    with pytest.raises(
        DataSetError, match=r"holds 2 candump logs, such as again.candump and wheels.candump; give a folder"
    ):
        import_data_set(folder, tmp_path / "none")


def viewed(line: str) -> str:
    """A line of candump -l as candump -ta shows it."""
    time, channel, frame, *_ = line.split()
    number, _, data = frame.partition("#")
    return f" {time}  {channel}  {number}   [{len(data) // 2}]  {bytes.fromhex(data).hex(' ').upper()}"


@pytest.mark.parametrize("form", ["viewed", "cut", "shifted"])
def test_a_log_for_people_a_torn_one_and_a_clock_that_was_set_hold_the_same_drive(
    recorded_data: Callable[[str], Path], tmp_path: Path, form: str
) -> None:
    lines = (recorded_data("can_encoder") / "infant_candump.log").read_text().splitlines()
    if form == "viewed":
        lines = [viewed(line) for line in lines]
    elif form == "shifted":
        lines = [line.replace("(17000000", "(16999999") if k > 500 else line for k, line in enumerate(lines)]
    text = "\n".join(lines) + "\n"
    (tmp_path / "a.log").write_text(text[:-20] if form == "cut" else text)
    result = import_data_set(tmp_path / "a.log", tmp_path / "run")
    assert result["wheel_samples"] >= 498
    assert any("was set back" in warning for warning in result["warnings"]) == (form == "shifted")
    assert any("the log was cut off in this line" in note for note in result["notes"]) == (form == "cut")


def test_frames_of_another_bus_are_named_with_those_that_are_expected(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text("(1436509052.249713) can0 044#2A366C2BBA\n" * 3)
    (warning,) = import_data_set(tmp_path / "a.log", tmp_path / "run")["warnings"][:1]
    assert "the layout expects 181, 182, 701, 702, the most frequent ids are 044; give the" in warning


def test_a_configuration_without_encoders_cannot_read_a_candump(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text("(1436509052.249713) can0 044#2A366C2BBA\n")
    (tmp_path / "c.toml").write_text("seed = 2\n")
    with pytest.raises(DataSetError, match=r"c\.toml has no table \[encoders\]"):
        import_data_set(tmp_path / "a.log", tmp_path / "run", tmp_path / "c.toml")


@pytest.mark.parametrize("content", [b"", b"hello\n", b"\0" * 500, b"1,2,3\n4,5,6\n", bytes(range(256)) * 9])
def test_what_is_no_recording_is_told_what_a_source_may_be(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.log").write_bytes(content)
    with pytest.raises(DataSetError, match="not a recording that can be imported; expected a folder") as caught:
        import_data_set(tmp_path / "a.log", tmp_path / "run")
    assert "pickle" not in str(caught.value)
    assert not (tmp_path / "run").exists()


def test_a_candump_of_buses_without_end_is_told_in_a_few_words(tmp_path: Path) -> None:
    encoders = load_configuration(CONFIG / "rover.toml").encoders
    assert encoders is not None
    (tmp_path / "x.log").write_text("\n".join(f"({k}) can{k % 400} 181#{k % 251:02X}" for k in range(4000)))
    archive = load_candump(tmp_path / "x.log", encoders)
    notes, warnings = archive.left_out.sentences({})
    assert any("more than 16 buses" in each for each in (*notes, *warnings))
    assert max(map(len, (*notes, *warnings))) < 1000


def test_frames_beyond_what_fits_into_memory_are_left_out_and_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """1.2 million frames took 472 MB, and ten million all there was."""
    frames = [f"({1 + 0.01 * n}) can0 123#{n:016X}\n" for n in range(40)]
    (tmp_path / "x.log").write_text("".join(frames))
    encoders = load_configuration(CONFIG / "rover.toml").encoders
    assert encoders is not None
    monkeypatch.setattr(text_lines, "MOST_KEPT_BYTES", 9 * FRAME_BYTES)
    archive = load_candump(tmp_path / "x.log", encoders)
    assert archive.left_out.used["frames"] == 10
    warning = "what follows line 10 is more than fits into one run; split the log there"
    assert any(warning in sentence for sentence in archive.left_out.warnings)


def test_a_frame_of_a_log_takes_little_memory(tmp_path: Path) -> None:
    columns = FrameColumns()
    tracemalloc.start()
    for n in range(20_000):
        columns.add(1e-3 * n, 0, CanFrame(0, 0x123, n.to_bytes(8, "big")))
    assert tracemalloc.get_traced_memory()[0] < 50 * 20_000
    tracemalloc.stop()
    assert columns.frame(777, 5) == CanFrame(5, 0x123, (777).to_bytes(8, "big"))


def test_a_capture_without_an_end_is_read_in_pieces(tmp_path: Path) -> None:
    with (tmp_path / "x.scip").open("wb") as stream:
        stream.write(described())
        stream.truncate(200_000_000)
    tracemalloc.start()
    archive = load_scip(tmp_path / "x.scip")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 5_000_000
    assert "ranges" not in archive


@pytest.mark.parametrize(("name", "most"), [("MOST_MESSAGES", 5), ("KEPT_BYTES", 50_000)])
def test_a_capture_of_more_than_fits_is_read_up_to_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, most: int
) -> None:
    """45 MB of messages of one byte took more than a minute, in which nothing was said."""
    (tmp_path / "a.logr").write_bytes(b"".join([described(), *scan_messages(20)]))
    monkeypatch.setattr(scip_capture, "KEPT_TIMES", 0)
    monkeypatch.setattr(scip_capture, name, most)
    archive = load_scip(tmp_path / "a.logr")
    assert 2 <= len(archive.arrays["scan_t"]) <= 5
    told = "a.logr holds more than fits into memory and is read up to its message"
    assert any(told in warning for warning in archive.left_out.warnings)
