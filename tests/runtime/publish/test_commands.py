"""A command reaches a rover only where it is on and a rule allows it, and it stands in the record."""

import json
import math
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from drivers.measurements import Event
from runtime.cli import rover as of_rover
from runtime.commands import LONGEST_REASON, MOST_WAITING, Command, CommandQueue, command_of, told_pose
from runtime.errors import ConfigurationError, SensorError
from runtime.health import HealthMonitor
from runtime.live.clock import MonotonicClock
from runtime.live.loop import Inputs, Loop, Outputs
from runtime.live.stage_clock import StageClock
from runtime.publish.commands import send_command
from runtime.publish.publisher import ZenohPublisher
from runtime.publish.session import rover_config, tool_config
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.manifest import Manifest
from runtime.record.reader import RunReader
from runtime.record.writing.recorder import STOPPED, Recorder
from runtime.settings.configuration import load_configuration_text
from runtime.tick import CompletedTick, Sink
from slam.settings.slam import SlamSettings
from tests.runtime.live.test_loop import StillSensors
from tests.support.runtime.small_estimator import SmallEstimator
from tests.support.zenoh.fleet import Fleet, routing, running_fleet
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until

ELSEWHERE = "tcp/127.0.0.1:9"  # nobody listens there, as no router does at 7447 on a rover that is alone
REFUSED_S = 0.7  # how long a test waits for an answer that must not come


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    with running_fleet(tmp_path_factory.mktemp("ca")) as fleet:
        yield fleet


def command(fleet: Fleet, name: str, asked: Command, reason: str = "seen", within_s: float = 120.0) -> bool:
    """Whether the rover accepted what someone with the certificate of this name asked; False at once if unheard."""
    try:
        return send_command(fleet.endpoint, "rover1", asked, reason, str(fleet.tool_file(name)), within_s).accepted
    except SensorError:
        return False


def test_an_operator_commands_and_a_viewer_and_another_rover_do_not(fleet: Fleet) -> None:
    with publishing(fleet.rover_settings("rover1", commands=True), "rover1") as publisher:
        assert until(lambda: command(fleet, "operator", Command.MARK))
        assert publisher.drain_events()
        for name in ("viewer", "rover1", "rover2"):
            assert not command(fleet, name, Command.STOP, within_s=REFUSED_S), name
        assert publisher.drain_events() == ()


def test_commands_are_off_unless_the_configuration_says_so(fleet: Fleet) -> None:
    settings = fleet.rover_settings("rover1")
    with publishing(settings, "rover1", configuration_text="x") as publisher, fleet.client("viewer") as viewer:
        assert until(lambda: any(reply.ok for reply in viewer.get("infant/rover1/configuration", timeout=1.0)))
        assert not command(fleet, "operator", Command.MARK, within_s=REFUSED_S)
        assert publisher.drain_events() == ()


def test_a_router_that_shows_another_rovers_certificate_commands_nothing(fleet: Fleet) -> None:
    impostor = Fleet(fleet.certificates, f"tls/127.0.0.1:{free_port()}")
    with (
        routing(impostor, "rover2"),
        publishing(impostor.rover_settings("rover1", commands=True), "rover1") as publisher,
    ):
        assert until(lambda: publisher.listening is not None)
        assert not command(impostor, "operator", Command.STOP, within_s=REFUSED_S)
        assert publisher.drain_events() == ()


def test_a_question_with_wildcards_is_no_command(tmp_path: Path) -> None:
    file = tmp_path / "loopback.json5"
    rule = (
        '{id: "all", permission: "allow", flows: ["ingress", "egress"], key_exprs: ["**"], '
        'messages: ["query", "reply", "declare_queryable"]}'
    )
    file.write_text(
        f'{{access_control: {{enabled: true, default_permission: "deny", rules: [{rule}], '
        'subjects: [{id: "here", interfaces: ["lo"]}], policies: [{rules: ["all"], subjects: ["here"]}]}}'
    )
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    with publishing(settings_on(port, commands=True, config_file=str(file))) as publisher:
        assert opened(publisher)
        with zenoh.open(tool_config(endpoint)) as session:
            for key in ("infant/**", "infant/r1/command/*", "**"):
                answers = [reply.ok.payload.to_bytes() for reply in session.get(key, payload=b"x") if reply.ok]
                assert not [answer for answer in answers if b"accepted" in answer]
        assert publisher.drain_events() == ()
        assert send_command(endpoint, "r1", Command.SAVE, "").accepted
        assert [command_of(event) for event in publisher.drain_events()] == [Command.SAVE]


def test_commands_without_access_rules_stop_the_start(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"publish = .*expected config_file to name .* access_control"):
        load_configuration_text("[publish]\ncommands = true\n")
    plain = tmp_path / "plain.json5"
    plain.write_text('{mode: "peer"}')
    with pytest.raises(ConfigurationError, match=r"publish.commands = True: access_control is not enabled"):
        rover_config(settings_on(0, commands=True, config_file=str(plain)), "r1", ())


def test_a_reason_that_says_nothing_or_too_much_is_refused() -> None:
    commands = CommandQueue(lambda: 5)
    assert "got 0" in commands.accept(Command.MARK, b"  ")
    assert f"got {LONGEST_REASON + 1}" in commands.accept(Command.SAVE, b"x" * (LONGEST_REASON + 1))
    assert commands.accept(Command.SAVE, b"\xff broken UTF-8") == ""
    for _ in range(MOST_WAITING - 1):
        assert commands.accept(Command.SAVE, b"") == ""
    assert "wait" in commands.accept(Command.SAVE, b"")
    assert len(commands.drain_events()) == MOST_WAITING
    assert commands.accept(Command.STOP, b"enough") == ""
    assert "stopped" in commands.accept(Command.MARK, b"too late")
    assert [(event.kind, event.reason, event.stamp_ns) for event in commands.drain_events()] == [("stop", "enough", 5)]


def test_events_of_others_are_no_commands() -> None:
    assert command_of(Event(0, "laser", "stop", "")) is None
    assert command_of(Event(0, "command", "dance", "")) is None
    assert command_of(Event(0, "command", "stop", "")) is Command.STOP


def test_each_command_over_the_wire_is_obeyed_and_stands_in_the_record(fleet: Fleet, tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", tmp_path)
    recorder = Recorder(folder, RunHeader.of_live_run("", {}))
    publisher = ZenohPublisher(fleet.rover_settings("rover1", commands=True), "rover1")
    sensors, clock, stop = StillSensors(), MonotonicClock(), threading.Event()
    sinks: dict[str, Sink] = {"record": recorder, "publish": publisher}
    loop = Loop(
        StageClock(clock),
        SmallEstimator(SlamSettings(), 1),
        Inputs(sensors, sensors, publisher.drain_events),
        Outputs(sinks, HealthMonitor(), lambda *watched: None),
        20_000_000,
    )
    driving = threading.Thread(target=loop.run, args=(clock.now_ns(), stop, 60_000_000_000))
    driving.start()
    try:
        assert until(lambda: command(fleet, "operator", Command.MARK, "people on the path"))
        assert until(lambda: any(line["kind"] == "mark" for line in Manifest.load(folder.manifest_path).lines))
        assert until(lambda: command(fleet, "operator", Command.SAVE))
        assert until(lambda: folder.closed_path(1).exists())
        assert until(lambda: command(fleet, "operator", Command.STOP, "enough"))
        assert until(lambda: STOPPED in recorder.health().trouble)
        beats = loop.timekeeping.ticks
        assert until(lambda: loop.timekeeping.ticks > beats + 3), "the rover drives on"
    finally:
        stop.set()
        driving.join()
        publisher.close()
        recorder.close()
    ticks = list(RunReader(folder.path).ticks())
    recorded = [event for tick in ticks for event in tick.tick.events if event.source == "command"]
    told = [(event.kind, event.reason) for event in recorded]
    assert told == [("mark", "people on the path"), ("save", "seen"), ("stop", "enough")]
    assert ticks[-1].tick.events[-1].kind == "stop", "the last tick of the record is the one that says so"
    marks = [line for line in Manifest.load(folder.manifest_path).lines if line["kind"] == "mark"]
    assert [mark["reason"] for mark in marks] == ["people on the path"]


def test_save_keeps_the_map(tmp_path: Path) -> None:
    import numpy as np

    from runtime.tick import Tick
    from tests.support.runtime.recorded_values import make_estimate, make_timing

    folder = RunFolder.create(tmp_path / "run", tmp_path)
    recorder = Recorder(folder, RunHeader.of_live_run("", {}))
    estimate = make_estimate(1_000, np.random.default_rng(1))
    tick = Tick(3, 1_000, None, (), (Event(900, "command", "save", "at the gate"),))
    recorder.put(CompletedTick(tick, estimate, make_timing(3), bytes(16), None))
    assert until(folder.map_path.exists)
    recorder.close()
    assert estimate.landmarks is not None
    kept = json.loads(folder.map_path.read_text())
    assert kept["identities"] == estimate.landmarks.identities.tolist()
    assert kept["stamp_ns"] == 1_000


@pytest.mark.parametrize(
    ("payload", "why"),
    [
        (b"", "an empty pose: expected X,Y,YAW"),
        (b"here", "here: expected X,Y,YAW"),
        (b"1,2", "1,2: expected X,Y,YAW"),
        (b"1,2,3,4", "expected X,Y,YAW"),
        (b"1,2,nan", "expected X,Y,YAW"),
        (b"1,2,inf,1,1", "expected X,Y,YAW"),
        (b"1e9,2,3", "expected X, Y and YAW within 1e+07"),
        (b"1,2,3,0,1", "expected SIGMA_M above 0 and at most 100"),
        (b"1,2,3,1,-1", "SIGMA_RAD above 0"),
        (b"1,2,3,1e5,1", "give no pose"),
        (b"\xff\xfe,1,2", "expected X,Y,YAW"),
        (b"[" * 3000, "expected X,Y,YAW"),
    ],
)
def test_a_pose_that_is_none_is_refused_in_one_sentence(payload: bytes, why: str) -> None:
    commands = CommandQueue(lambda: 5)
    refusal = commands.accept(Command.INITIAL_POSE, payload)
    assert why in refusal
    assert "\n" not in refusal
    assert len(refusal) < 300
    assert commands.drain_events() == ()


def test_the_last_pose_of_a_tick_counts_and_a_stopped_recording_does_not_matter() -> None:
    commands = CommandQueue(lambda: 5)
    assert commands.accept(Command.STOP, b"") == ""
    assert "stopped" in commands.accept(Command.MARK, b"seen")
    assert commands.accept(Command.INITIAL_POSE, b"1,2,0.5") == ""
    assert "stopped" in commands.accept(Command.MARK, b"seen")
    assert commands.accept(Command.INITIAL_POSE, b"-3.5,2e1,7,0.2,0.1") == ""
    told = told_pose(commands.drain_events())
    assert told is not None
    assert (told.pose.x_m, told.pose.y_m, told.sigma_m, told.sigma_rad) == (-3.5, 20.0, 0.2, 0.1)
    assert told.pose.heading_rad == pytest.approx(7.0 - 2.0 * math.pi)
    assert told_pose(()) is None
    assert told_pose((Event(5, "command", "initial_pose", "nonsense"),)) is None


def test_a_command_without_an_address_finds_the_rover_that_status_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_port()
    monkeypatch.setattr("runtime.publish.find_rover.ENDPOINTS", (ELSEWHERE, f"tcp/127.0.0.1:{port}"))
    with publishing(settings_on(port)) as publisher:
        assert opened(publisher)
        put_ticks(publisher, range(3), 0.0)  # what it answers is known from then on
        with pytest.raises(SensorError, match=f"r1 at tcp/127.0.0.1:{port} does not answer .* is publish.commands on"):
            of_rover.command(of_rover.CommandWord.save)
