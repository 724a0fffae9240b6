"""A rover that is heard is drawn as one that was recorded, and strangers' messages change nothing."""

import json
import threading
from contextlib import nullcontext
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers.measurements import Scan
from runtime.cli.__main__ import app
from runtime.errors import StorageError, UsageError
from runtime.live_view import view
from runtime.live_view.ticks import HEARD, LiveTicks, path_of
from runtime.live_view.view import draw_live, view_live
from runtime.messages.definitions import deserialize, serialize
from runtime.messages.map_json import json_bytes, landmark_json
from runtime.publish.find_rover import FoundRover
from runtime.publish.follow import Message
from runtime.publish.messages import event_json, status_object
from runtime.review.ticks import AssembledTick
from runtime.ros2.laser_scan import scan_bytes
from runtime.ros2.odometry import OdometryTrack, odometry_bytes
from runtime.ros2.poses import POSE, DrivenPath, particle_bytes, pose_bytes
from runtime.ros2.vehicle import Vehicle
from runtime.tick import CompletedTick
from tests.support.runtime.drawn_drive import MOUNT, completed_ticks

WALL_NS = 1_700_000_000_000_000_000
VEHICLE = Vehicle(MOUNT)


def said(completed: CompletedTick, track: OdometryTrack) -> list[Message]:
    """The messages of one tick, in the order in which a rover sends them."""
    estimate, wall_ns = completed.estimate, completed.estimate.stamp_ns + WALL_NS
    assert isinstance(completed.tick.scan, Scan)
    assert estimate.particles is not None
    messages = [
        Message("pose", pose_bytes(wall_ns, estimate)),
        Message("odom", odometry_bytes(wall_ns, track.take(estimate))),
        *(Message("event", event_json(event, wall_ns)) for event in completed.tick.events),
        Message("scan_full", scan_bytes(completed.tick.scan, WALL_NS, VEHICLE)),
        Message("particles", particle_bytes(wall_ns, estimate.particles)),
    ]
    if estimate.landmarks is not None:
        messages.append(Message("map", landmark_json(estimate.landmarks, wall_ns)))
    return messages


def heard(count: int) -> list[tuple[CompletedTick, AssembledTick]]:
    ticks, track, pairs = LiveTicks("r1"), OdometryTrack(VEHICLE.odometry), []
    before: CompletedTick | None = None
    for completed in completed_ticks(count):
        for message in said(completed, track):
            if (assembled := ticks.take(message)) is not None:
                assert before is not None
                pairs.append((before, assembled))
        before = completed
    return pairs


def test_every_tick_comes_out_with_its_own_pose_scan_and_particles() -> None:
    pairs = heard(20)
    assert len(pairs) == 19
    for completed, assembled in pairs:
        wanted, got = completed.estimate, assembled.estimate
        assert got is not None
        assert got.stamp_ns == wanted.stamp_ns + WALL_NS
        np.testing.assert_allclose(got.map_from_body.as_array(), wanted.map_from_body.as_array(), atol=1e-9)
        np.testing.assert_allclose(got.odom_from_body.as_array(), wanted.odom_from_body.as_array(), atol=1e-9)
        np.testing.assert_allclose(got.covariance, wanted.covariance)
        assert [event.reason for event in assembled.tick.events] == [event.reason for event in completed.tick.events]
        scan, own = assembled.tick.scan, completed.tick.scan
        assert isinstance(scan, Scan)
        assert isinstance(own, Scan)
        np.testing.assert_array_equal(np.isfinite(scan.ranges_m), np.isfinite(own.ranges_m))
        np.testing.assert_allclose(scan.bearings_rad, own.bearings_rad, atol=1e-5)
        assert (got.landmarks is None) == (wanted.landmarks is None)


def test_what_a_status_tells_of_filter_and_loop_is_drawn_once() -> None:
    ticks, track, told = LiveTicks("r1"), OdometryTrack(VEHICLE.odometry), []
    for number, completed in enumerate(completed_ticks(12)):
        messages = said(completed, track)
        if number == 1:
            status = {
                **status_object("r1", WALL_NS, completed, 10.0, None),
                "listening": [],
                "host": "",
                "instance": "",
            }
            messages.append(Message("status", json_bytes(status)))
            wanted = completed
        told += [assembled for message in messages if (assembled := ticks.take(message)) is not None]
    drawn = [assembled for assembled in told if assembled.timing is not None]
    assert len(told) == 11
    assert len(drawn) == 1
    assert drawn[0].timing is not None
    assert drawn[0].estimate is not None
    assert drawn[0].timing.stages_ns["step"] == pytest.approx(wanted.timing.stages_ns["step"], abs=1000)
    assert drawn[0].estimate.counts["effective_particles"] == pytest.approx(
        wanted.estimate.counts["effective_particles"], abs=0.051
    )
    assert all(not assembled.estimate.counts for assembled in told if assembled.estimate and assembled is not drawn[0])


@pytest.mark.parametrize("name", [*HEARD, "map"])
@pytest.mark.parametrize("data", [b"", b"junk", b"\0\1\0\0" + b"\xff" * 200, b"{}", b"[" * 10_000])
def test_what_no_rover_says_ends_no_tick_and_breaks_none(name: str, data: bytes) -> None:
    ticks, track = LiveTicks("r1"), OdometryTrack(VEHICLE.odometry)
    first, second = completed_ticks(2)
    for message in said(first, track):
        assert ticks.take(message) is None
    assert ticks.take(Message(name, data)) is None
    assert ticks.take(said(second, track)[0]) is not None


def test_events_without_end_keep_nobody_busy() -> None:
    ticks = LiveTicks("r1")
    for stamp_ns in (*range(1000), 10**300, -(1 << 63)):
        said = {"source": "laser", "kind": "slow", "severity": "warn", "reason": "x", "stamp_ns": stamp_ns}
        assert ticks.take(Message("event", json.dumps(said).encode())) is None
    assert [event.stamp_ns for event in ticks._events] == list(range(800, 1000))


def test_a_pose_that_is_nowhere_is_no_tick() -> None:
    ticks, (completed,) = LiveTicks("r1"), completed_ticks(1)
    nowhere = replace(completed.estimate, covariance=np.full((3, 3), np.nan))
    for _ in range(3):
        assert ticks.take(Message("pose", pose_bytes(WALL_NS, nowhere))) is None


def test_the_way_driven_before_is_known_to_who_comes_late() -> None:
    path = DrivenPath()
    for completed in completed_ticks(40):
        path.add(completed.estimate.stamp_ns, completed.estimate.map_from_body)
    assert path_of(path.as_bytes(WALL_NS)).shape == (len(path), 2)


def test_words_that_do_not_fit_together_and_nobody_there_are_one_sentence() -> None:
    for words, text in (
        (["view"], "no run given"),
        (["view", "run", "--rover", "r1"], "add --live"),
        (["view", "--live", "--screenshot", "x.png"], "leave out --live"),
    ):
        error = CliRunner().invoke(app, words).exception
        assert isinstance(error, UsageError)
        assert text in str(error)
    with pytest.raises(Exception, match="no rover answers"):
        view_live("tcp/127.0.0.1:1", None, None, False, threading.Event(), print)


def test_who_serves_a_rover_to_a_browser_is_told_where_and_not_what_the_viewer_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    viewer = Mock(**{"return_value.poll.return_value": 0})
    monkeypatch.setattr(view, "find_rover", lambda *_: FoundRover("r1", "tcp/127.0.0.1:1"))
    monkeypatch.setattr("subprocess.Popen", viewer)
    for name in ("_await", "draw_live"):
        monkeypatch.setattr(view, name, Mock())
    told: list[str] = []
    assert view_live(None, None, None, True, threading.Event(), told.append) == 0
    (command,), kept = viewer.call_args
    port = command[command.index("--web-viewer-port") + 1]
    assert told[0].startswith(f"r1 is shown at http://127.0.0.1:{port}?url=rerun")
    assert kept["env"]["RUST_LOG"] == "error"


def test_a_viewer_that_was_closed_is_no_error_of_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    writer = Mock(**{"close.side_effect": StorageError("live is incomplete; free space and draw it again")})
    follower = Mock(**{"has_come.return_value": True, "next.return_value": None})
    monkeypatch.setattr(view, "following", lambda *_: nullcontext(follower))
    monkeypatch.setattr(view, "_begin", lambda *_: writer)
    still_open = iter((True, False))
    drawn = draw_live(FoundRover("r1", "tcp/127.0.0.1:1"), None, "", lambda: next(still_open), threading.Event())
    assert drawn == 0
    writer.close.assert_called_once()


def test_json_of_the_map_is_what_the_rover_answers() -> None:
    landmarks = next(completed_ticks(1)).estimate.landmarks
    assert landmarks is not None
    assert json.loads(landmark_json(landmarks, 0))["existence"]


def test_a_heading_that_is_no_number_is_not_drawn() -> None:
    ticks, estimate = LiveTicks("r1"), next(iter(completed_ticks(1))).estimate
    odd = deserialize(POSE, pose_bytes(1, estimate))
    odd.pose.pose.orientation.z = odd.pose.pose.orientation.w = float("nan")
    assert ticks.take(Message("pose", pose_bytes(1, estimate))) is None
    assert ticks.take(Message("pose", serialize(POSE, odd))) is None
    drawn = ticks.take(Message("pose", pose_bytes(2, estimate)))
    assert drawn is not None
    assert drawn.estimate is not None
    assert np.isfinite(drawn.estimate.map_from_body.as_array()).all()
