"""What a review costs is counted, not timed: what it loads, and how often it does the same."""

import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from runtime.calibrate import calibration
from runtime.calibrate.scans import laser_motion
from runtime.calibrate.scans.shapes import shapes
from runtime.map_files.confirmed import CONFIRMED_LOG_ODDS
from runtime.messages import tick as messages
from runtime.messages.definitions import TYPES, deserialize
from runtime.messages.tick import Record
from runtime.record.reader import RunReader
from runtime.report.findings.pose import UNCERTAIN_GAP_M
from runtime.report.gather import gather
from runtime.report.plots.plots import Plots, embedded
from runtime.review.rebuild import build_review
from runtime.review.writer import AFTERWARDS_TICKS, ReviewWriter
from runtime.settings.review import ReviewSettings
from slam import quality
from slam.joint import gaussian
from tests.runtime.review.test_rebuild import Drawn
from tests.support.runtime.drawn_drive import MOUNT, drive
from tests.support.runtime.made_drives import START, Rover, park_drive
from tests.support.runtime.seeded_runs import seeded_facts

DRAWS = """
import sys, warnings
warnings.simplefilter("error")
from runtime.optional_packages import leave_out
leave_out("pandas")
import numpy as np, rerun as rr
from runtime.review.layout import Extent, layout
layout(Extent(), True)
rr.Points3D.columns(positions=np.zeros((4, 3), np.float32)).partition([4])
print("pandas" in sys.modules)
"""


def said_by(program: str) -> str:
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_who_draws_loads_no_pandas_and_draws_the_same_layout() -> None:
    assert said_by(DRAWS) == "False\n"


def test_who_judges_a_run_loads_neither_the_compiler_nor_the_filter() -> None:
    loaded = said_by("import sys, runtime.report.build; print(*sys.modules)").split()
    assert not {"numba", "rerun", "pandas", "slam.estimator", "slam.joint.gaussian"} & set(loaded)


def test_who_draws_begins_at_once_with_what_it_needs_and_no_command_line() -> None:
    loaded = said_by("import sys, runtime.review.rebuild; print(*sys.modules)").split()
    assert not {"typer", "scipy", "bokeh", "multiprocessing.resource_tracker"} & set(loaded)


@pytest.mark.parametrize("reads", ["judge", "draw"])
def test_a_message_is_decoded_once_at_most(reads: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seeded_facts(tmp_path / "run", 1, duration_s=5.0)
    held = Counter(record.topic for record in RunReader(tmp_path / "run").records())
    decoded: Counter[str] = Counter()
    topics = {name: topic for topic, name in TYPES.items()}

    def counting(type_name: str, data: bytes) -> Any:
        decoded[topics[type_name]] += 1
        return deserialize(type_name, data)

    monkeypatch.setattr(messages, "deserialize", counting)
    if reads == "judge":
        gather(tmp_path / "run")
    else:
        build_review(tmp_path / "run", tmp_path / "review.rrd")
    assert decoded["/estimate"] == held["/estimate"] > 40
    assert decoded == {topic: held[topic] for topic in decoded}


def test_the_numbers_that_are_told_without_the_filter_are_the_filters() -> None:
    assert CONFIRMED_LOG_ODDS == gaussian.CONFIRMED_LOG_ODDS
    assert UNCERTAIN_GAP_M == quality.UNCERTAIN_GAP_M


def test_the_shapes_of_a_scan_are_found_once_for_each_of_two_guesses_of_the_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found: Counter[bytes] = Counter()
    find = shapes

    def counting(scan: Any, twist: Any) -> Any:
        found[scan.ranges_m.tobytes()] += 1
        return find(scan, twist)

    monkeypatch.setattr(laser_motion, "shapes", counting)
    calibration.calibrate([park_drive(2, Rover(), 20.0)], START)
    assert len(found) > 15
    assert set(found.values()) == {2}


def test_plots_are_gone_through_once_and_not_again_with_each_that_is_added(monkeypatch: pytest.MonkeyPatch) -> None:
    from bokeh.document.models import DocumentModelManager

    gone_through = []
    recompute = DocumentModelManager.recompute

    def counting(manager: Any) -> None:
        gone_through.append(1)
        recompute(manager)

    monkeypatch.setattr(DocumentModelManager, "recompute", counting)
    plots = Plots(10.0)
    _, places = embedded({str(number): plots.over_time([], "m", ()) for number in range(8)})
    assert len(places) == 8
    assert len(gone_through) < 8


def test_a_path_that_is_drawn_afterwards_ends_a_second_before_the_rover_at_most(tmp_path: Path) -> None:
    ticks = 60
    records: list[Record] = [record for tick in drive(ticks) for record in tick]
    assert ticks < AFTERWARDS_TICKS
    writer = ReviewWriter(tmp_path / "review.rrd", ReviewSettings(), MOUNT, batch_ticks=AFTERWARDS_TICKS)
    for record in records:
        writer.feed(record)
    writer.close()
    ends_s = Drawn(tmp_path / "review.rrd").elapsed_s["/map/path/SLAM"]
    assert ends_s == pytest.approx([0.9, 1.9, 2.9, 3.9, 4.9, 5.9])
