"""Records of others whose bytes are messages, and whose numbers are those of no laser and no filter."""

import dataclasses
import math
import struct
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.errors import NotARunError
from runtime.messages.definitions import TYPES, deserialize, serialize
from runtime.messages.estimate import decode_estimate, encode_estimate
from runtime.messages.tick import Record
from runtime.record.check import recover_run, verify_run
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.reader import RunReader
from runtime.record.trajectories import read_trajectories
from runtime.replay.difference import first_difference
from tests.runtime.record.test_hostile_runs import records_of
from tests.support.runtime.hostile_runs import HEADER, run_of
from tests.support.runtime.recorded_values import make_estimate

SIGNALLING: float = struct.unpack("<d", struct.pack("<Q", 0x7FF0000000000001))[0]
NUMBERS = (math.nan, SIGNALLING, math.inf, -math.inf, 1e300, 3e38)
FIGURES = ("range_max_m", "beam_period_s", "bearing_first_rad", "bearing_increment_rad")


def run_with(folder: Path, topic: str, change: Callable[[Any], None]) -> Path:
    """A run of two ticks, in the second of which a message says something else."""

    def changed(record: Record) -> Record:
        if record.topic != topic:
            return record
        message = deserialize(TYPES[topic], record.data)
        change(message)
        return dataclasses.replace(record, data=serialize(TYPES[topic], message))

    return run_of(folder, [records_of(0), list(map(changed, records_of(1)))])


def read(run: Path) -> None:
    for recorded in RunReader(run).ticks():
        assert recorded.estimate is not None


@pytest.mark.parametrize("value", NUMBERS)
@pytest.mark.parametrize("name", FIGURES)
def test_a_scan_of_no_laser_is_refused_with_its_place(tmp_path: Path, name: str, value: float) -> None:
    """Drawing, exporting and comparing computed distances and times with such numbers, and ended with a traceback."""
    run = run_with(tmp_path / "run", "/tick", lambda message: setattr(message, name, value))
    with pytest.raises(NotARunError, match=r"run\.mcap.*/tick"):
        read(run)


@pytest.mark.parametrize(
    "change",
    [
        lambda message: setattr(message, "bearing_increment_rad", -0.01),
        lambda message: setattr(message, "bearing_increment_rad", 1.0),
        lambda message: setattr(message, "bearings_rad", np.linspace(0.0, -3.0, 40)),
        lambda message: setattr(message, "bearings_rad", np.full(40, math.nan)),
        lambda message: setattr(message, "stamp_beam", 40),
        lambda message: setattr(message, "stamp_beam", -(1 << 31)),
    ],
    ids=["clockwise", "six turns", "clockwise one by one", "no numbers", "beyond the last beam", "before the first"],
)
def test_beams_that_are_none_of_a_sweep_are_refused(tmp_path: Path, change: Callable[[Any], None]) -> None:
    with pytest.raises(NotARunError, match=r"run\.mcap.*/tick"):
        read(run_with(tmp_path / "run", "/tick", change))


def test_verdicts_on_other_beams_than_the_scan_has_are_refused(tmp_path: Path) -> None:
    """Drawing a map chose beams by them."""
    run = run_with(
        tmp_path / "run", "/estimate", lambda message: setattr(message, "beam_verdicts", np.zeros(7, np.uint8))
    )
    with pytest.raises(NotARunError, match=r"run\.mcap.*7 verdicts on 40 beams"):
        read(run)
    recover_run(run, RunFolder.create(tmp_path / "whole", tmp_path))
    assert [recorded.estimate is None for recorded in RunReader(tmp_path / "whole").ticks()] == [False, True]


@pytest.mark.parametrize("name", ["map_from_body", "particle_mean", "odom_from_body", "count_values"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_an_estimate_without_numbers_is_refused(tmp_path: Path, name: str, value: float) -> None:
    """Drawing, exporting, evaluating and reviewing ended with a traceback."""

    def change(message: Any) -> None:
        setattr(message, name, np.full(getattr(message, name).shape, value))

    run = run_with(tmp_path / "run", "/estimate", change)
    with pytest.raises(NotARunError, match=r"run\.mcap.*/estimate.*number|pose of"):
        read(run)
    with pytest.raises(NotARunError, match=r"run\.mcap.*/estimate"):
        read_trajectories(RunReader(run))


@pytest.mark.parametrize(
    ("topic", "name"), [("/tick", "stamp_ns"), ("/tick", "seen_stamp_ns"), ("/estimate", "stamp_ns")]
)
@pytest.mark.parametrize("stamp_ns", [(1 << 63) - 1, -(1 << 63), 1 << 62])
def test_stamps_that_cannot_be_added_to_others_are_refused(
    tmp_path: Path, topic: str, name: str, stamp_ns: int
) -> None:
    """With the offset to wall time they are no int64 any more: exporting ended with a traceback."""
    with pytest.raises(NotARunError, match=r"run\.mcap.*a stamp of"):
        read(run_with(tmp_path / "run", topic, lambda message: setattr(message, name, stamp_ns)))


@pytest.mark.parametrize(("offset_ns", "is_known"), [(1 << 62, False), (-(10**30), False), ((1 << 62) - 1, True)])
def test_a_wall_time_that_no_clock_shows_is_unknown(offset_ns: int, is_known: bool) -> None:
    header = dataclasses.replace(HEADER, wall_minus_monotonic_ns=offset_ns)
    assert RunHeader.from_metadata(header.metadata).wall_minus_monotonic_ns == (offset_ns if is_known else None)


def test_a_count_of_the_filter_that_is_no_number_is_not_recorded() -> None:
    estimate = make_estimate(1, np.random.default_rng(0))
    estimate = dataclasses.replace(estimate, counts={"odds": math.inf, "landmarks": 2.0})
    assert decode_estimate(encode_estimate(estimate).data).counts == {"landmarks": 2.0}


def test_a_signalling_nan_in_ranges_becomes_an_ordinary_one(tmp_path: Path) -> None:
    """It warned in the journal wherever float32 was made wider: replay, review, calibrate."""

    def change(message: Any) -> None:
        message.ranges = np.full(40, 0x7F800001, np.uint32).view(np.float32)

    run = run_with(tmp_path / "run", "/scan", change)
    verify_run(run)
    scan = list(RunReader(run).ticks())[1].tick.scan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert scan is not None
        assert np.isnan(scan.ranges_m.astype(np.float64)).all()


def test_an_estimate_that_lacks_an_array_differs_from_one_that_has_it(tmp_path: Path) -> None:
    """None == array is an array of answers: comparing ended with a traceback."""
    run = run_with(tmp_path / "run", "/estimate", lambda message: setattr(message, "has_particles", False))
    recorded = list(RunReader(run).ticks())[1]
    assert recorded.estimate is not None
    replayed = dataclasses.replace(recorded.estimate, particles=np.zeros((10, 3)), particle_weights=np.ones(10))
    assert "particles" in first_difference(recorded, replayed, bytes(16))


def test_a_command_prints_no_warning_of_a_library(tmp_path: Path) -> None:
    """A pose of 1e300 m is a number: numpy warned of it on standard error, with lines of our source."""

    def change(message: Any) -> None:
        message.map_from_body = np.full(3, 1e300)

    run = run_with(tmp_path / "run", "/estimate", change)
    ended = subprocess.run(
        [sys.executable, "-m", "runtime.cli", "review", str(run), "--out", str(tmp_path / "page.html")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.returncode, ended.stderr) == (0, "")
