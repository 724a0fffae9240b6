"""From what is heard to a configuration that can be used."""

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.canbus.frame import EXTENDED, CanFrame
from drivers.measurements import DriverError, LinkError
from drivers.settings.can import BusSettings
from drivers.settings.layouts import Cia406Layout, DbcLayout, Layout, PresetLayout
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.simulated.wheels.encoder_nodes import EncoderNodes
from drivers.wheels.layouts.choose import layout_messages
from drivers.wheels.layouts.messages import FeedbackMessage
from drivers.wheels.layouts.presets import preset_layout
from drivers.wheels.readings import Wheel
from runtime.api.simulated import SimulatedRover
from runtime.errors import SensorError, StorageError, UsageError
from runtime.settings.configuration import load_configuration
from runtime.setup.discover import wizard
from runtime.setup.discover.can_traffic import traffic_of
from runtime.setup.discover.counts_heard import counts_heard, counts_line
from runtime.setup.discover.dbc_match import layouts_in
from runtime.setup.discover.listen import LaserFound, bus_named, can_interfaces, find_laser, hear
from runtime.setup.discover.wheel_layouts import LayoutFound, layouts_that_fit
from runtime.setup.discover.wizard import Known, beside, set_up
from runtime.setup.discover.written import Geometry
from runtime.setup.validation import validate_for_live_run
from runtime.source_tree import CONFIG

LASER = LaserFound("tcp://192.168.0.10:10940", 'UST-20LX("new")', "1.0", "H1", 1081, -135.0, 135.0, 30.0)
GEOMETRY = Geometry(0.1, 0.4, 4096.0, 0.2, laser_backwards=True)
PRESETS = [
    PresetLayout(kind="preset", name=name, left_node=3, right_node=7)
    for name in ("odrive", "odrive_counts", "vesc", "cia402")
]


def frames_of(layout: Layout, count: int = 40) -> list[CanFrame]:
    """What two nodes of this layout send at 50 Hz while the rover is pushed."""
    assert isinstance(layout, DbcLayout | PresetLayout)
    described = preset_layout(layout) if isinstance(layout, PresetLayout) else layout
    messages, frames = layout_messages(described), []
    for side, signals in ((Wheel.LEFT, described.left), (Wheel.RIGHT, described.right)):
        message = FeedbackMessage(side, messages[signals.message], signals, 1.0)
        for k in range(count):
            values = {signals.count: 0.25 * k if layout.kind == "preset" and layout.name == "odrive" else 37 * k}
            values |= {signals.alive: k % 16} if signals.alive else {}
            frames.append(message.encode(values, 20_000_000 * k))
    return sorted(frames)


def cia406_frames() -> list[CanFrame]:
    nodes = [(t * 1_000_000, node, t.to_bytes(4, "little") + bytes(3)) for t in range(0, 800, 20) for node in (1, 2)]
    frames = [CanFrame(stamp_ns, 0x180 + node, data) for stamp_ns, node, data in nodes]
    return sorted(frames + [CanFrame(stamp_ns, 0x700 + node, b"\x05") for stamp_ns, node, _ in nodes[::19]])


def searching(frames: list[CanFrame]) -> tuple[Callable[..., LaserFound], Callable[..., list[CanFrame]]]:
    return (lambda _urls: LASER), (lambda _bus, _seconds: frames)


def test_infants_own_nodes_are_described_to_the_counter_and_the_checksum() -> None:
    left, right = traffic_of(frames_of(DbcLayout()))
    assert (left.name, left.length, left.alive) == ("0x181", 8, "alive counter in byte 6, low half")
    assert left.crc == "CRC-8 SAE J1850 over id and data in byte 7"
    assert left.rate_hz == pytest.approx(50.0)
    assert {0, 6, 7} <= set(left.moving_bytes)
    assert 5 not in left.moving_bytes
    assert "50.0 Hz" in right.line()


def test_constant_bytes_are_neither_a_counter_nor_a_checksum() -> None:
    still = [CanFrame(k * 10_000_000, 0x100, bytes(8)) for k in range(50)]
    (found,) = traffic_of(still)
    assert (found.moving_bytes, found.alive, found.crc) == ((), "", "")
    (once,) = traffic_of(still[:1])
    assert once.line() == "0x100  once, 8 bytes, changing bytes: none"


@pytest.mark.parametrize("layout", [DbcLayout(), *PRESETS], ids=lambda layout: getattr(layout, "name", "infant"))
def test_the_layout_that_sent_the_frames_is_the_first_that_fits(layout: Layout) -> None:
    others = [CanFrame(k * 10_000_000, 0x321, bytes((k, 0))) for k in range(80)]
    found = layouts_that_fit(traffic_of(frames_of(layout) + others))
    assert found[0].layout == layout
    assert found[0].rate_hz == pytest.approx(50.0)


def test_a_dbc_at_hand_is_tried_against_what_is_heard(tmp_path: Path) -> None:
    dbc = CONFIG / "examples" / "steered.dbc"
    layout = load_configuration("examples/steered").encoders
    assert layout is not None
    assert isinstance(layout.layout, DbcLayout)
    nodes = EncoderNodes(SimulatedWheelSettings(), layout, 0, np.random.default_rng(1))
    beats = [(wheel, 20_000_000 * k) for k in range(40) for wheel in Wheel]
    frames = [frame for wheel, t_ns in beats for frame in nodes.beat(wheel, t_ns, t_ns * 1e-9)]
    path = tmp_path / "rover.toml"
    with pytest.raises(SensorError, match="--dbc FILE"):
        set_up(path, "r1", Known(bus="can0"), lambda: GEOMETRY, lambda _line: None, searching(frames))
    set_up(path, "r1", Known(bus="can0", dbc=dbc), lambda: GEOMETRY, lambda _line: None, searching(frames))
    found = load_configuration(path).encoders
    assert found is not None
    metre = {"counts_per_unit": round(GEOMETRY.counts_per_rev / (2.0 * math.pi * GEOMETRY.wheel_radius_m), 6)}
    sides = {side: getattr(layout.layout, side).model_copy(update=metre) for side in ("left", "right")}
    assert found.layout == layout.layout.model_copy(update=sides)
    assert layouts_in(dbc, traffic_of([CanFrame(k, 0x99, b"a") for k in range(9)])) == []
    with pytest.raises(DriverError, match="not a DBC"):
        layouts_in(path, [])


def test_canopen_encoders_are_known_by_their_heartbeats() -> None:
    found = layouts_that_fit(traffic_of(cia406_frames()))
    assert [each.layout for each in found] == [Cia406Layout(kind="cia406", left_node=1, right_node=2)]


def test_one_node_or_three_are_not_the_wheels_of_a_rover() -> None:
    frames = [CanFrame(k * 20_000_000, 27 << 8 | node, bytes(8), EXTENDED) for k in range(40) for node in (1, 2, 3)]
    assert layouts_that_fit(traffic_of(frames)) == []
    assert layouts_that_fit(traffic_of(frames[::3])) == []


@pytest.mark.parametrize("layout", [DbcLayout(), *PRESETS], ids=lambda layout: getattr(layout, "name", "infant"))
def test_the_file_that_is_written_can_be_driven_with_and_is_short(layout: Layout, tmp_path: Path) -> None:
    path, said = tmp_path / "rover.toml", list[str]()
    result = set_up(path, "r1", Known(bus="can0"), lambda: GEOMETRY, said.append, searching(frames_of(layout)))
    configuration = load_configuration(path)
    validate_for_live_run(configuration, str(path))
    assert configuration.encoders is not None
    assert configuration.laser is not None
    assert configuration.encoders.layout == layout
    assert configuration.encoders.period_ms == pytest.approx(20.0)
    assert (configuration.laser.url, configuration.vehicle.tread_m) == (LASER.url, 0.4)
    assert configuration.slam.mount.yaw_rad == pytest.approx(3.14159, abs=1e-4)
    assert sum(bool(line.strip()) for line in result.text.splitlines()) <= 25
    assert any(line.startswith("laser     UST-20LX") for line in said)
    assert result.as_json()["config"] == str(path)
    with pytest.raises(StorageError, match="never overwritten"):
        set_up(path, "r1", Known(bus="can0"), lambda: GEOMETRY, said.append, searching([]))


def refuse(_bus: BusSettings, _seconds: float) -> list[CanFrame]:
    raise LinkError("can0 is down; ip link set can0 up")


@pytest.mark.parametrize(
    ("known", "search", "error", "named"),
    [
        (Known("tcp://1.2.3.4:10940", "can0"), (lambda _urls: None, refuse), SensorError, "1.2.3.4.*--laser URL"),
        (Known(bus="can0"), searching([]), SensorError, "nothing was heard on can0"),
        (Known(bus="can0"), ((lambda _urls: LASER), refuse), SensorError, "ip link set"),
        (Known(bus="can:x:y"), searching([]), UsageError, "INTERFACE:CHANNEL"),
        (Known(bus="can0"), searching([CanFrame(0, 0x99, b"a")]), SensorError, "ids 0x099 are heard"),
    ],
)
def test_what_is_not_found_ends_in_a_sentence_and_writes_nothing(
    known: Known, search: tuple[object, object], error: type[Exception], named: str, tmp_path: Path
) -> None:
    with pytest.raises(error, match=named):
        set_up(tmp_path / "a.toml", "r1", known, lambda: GEOMETRY, lambda _line: None, search)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_a_machine_without_can_says_how_to_name_a_bus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wizard, "can_interfaces", list)
    with pytest.raises(SensorError, match="no CAN interface"):
        set_up(tmp_path / "a.toml", "r1", Known(), lambda: GEOMETRY, lambda _line: None, searching([]))


def test_socketcan_interfaces_are_found_by_their_type(tmp_path: Path) -> None:
    for name, kind in (("eth0", "1"), ("can0", "280"), ("vcan1", "280")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text(f"{kind}\n")
    assert can_interfaces(tmp_path) == ["can0", "vcan1"]
    assert bus_named("udp_multicast:239.74.163.2:41000").port == 41000


def test_a_simulated_rover_is_found_over_its_real_wires(tmp_path: Path) -> None:
    path = tmp_path / "rover.toml"
    with SimulatedRover(load_configuration("mock")) as rover:
        bus = rover.wheels.bus
        known = Known(rover.laser.url, f"{bus.interface}:{bus.channel}:{bus.port}")
        result = set_up(path, None, known, lambda: GEOMETRY, lambda _line: None, (patient, hear_enough))
    assert result.laser.model.startswith("UTM-X001S")
    assert (result.laser.beams, result.laser.first_deg, result.laser.last_deg) == (1081, -135.0, 135.0)
    assert [each.name for each in result.fitting] == ["Infant"]
    assert "rover" not in load_configuration(path).model_fields_set  # nobody gave it a name: its machine has one
    encoders = load_configuration(path).encoders
    assert encoders is not None
    assert (encoders.bus.port, encoders.layout) == (bus.port, DbcLayout())


def patient(urls: Sequence[str]) -> LaserFound | None:
    return find_laser(urls, 120.0)


def hear_enough(bus: BusSettings, seconds: float) -> list[CanFrame]:
    """As long as a busy machine needs to send and to hear some frames of both wheels."""
    frames = list[CanFrame]()
    for _ in range(100):
        frames += hear(bus, seconds)
        if all(sum(frame.arbitration_id == number for frame in frames) >= 20 for number in (0x181, 0x182)):
            return frames
    raise AssertionError(f"only {len(frames)} frames heard")


@pytest.mark.parametrize("content", [b"\0" * 100, b"BO_ 1 A: 8 X\n" * 9 + b"\xff", b"BO_ (" + b"(" * 5000, b"<xml/>"])
def test_a_dbc_that_is_none_is_one_sentence(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x.arxml").write_bytes(content)
    try:
        assert layouts_in(tmp_path / "x.arxml", []) == []
    except DriverError as error:
        assert "\n" not in str(error)  # noqa: PT017 either outcome will do
    os.mkfifo(tmp_path / "pipe.dbc")
    with pytest.raises(DriverError, match="pipe"):
        layouts_in(tmp_path / "pipe.dbc", [])


def test_a_second_laser_is_named_and_the_first_in_order_is_used() -> None:
    with SimulatedRover(load_configuration("mock")) as rover, SimulatedRover(load_configuration("mock")) as other:
        urls = [rover.laser.url, other.laser.url]
        found = find_laser(urls, 120.0)
    assert found is not None
    assert found.url in urls
    assert set(found.others) <= set(urls) - {found.url}
    assert f"give --laser {urls[1]}" in replace(found, others=(urls[1],)).line()


def test_a_dbc_beside_the_file_is_named_relative_to_it(tmp_path: Path) -> None:
    layout = DbcLayout(file=str(tmp_path.resolve() / "maker" / "rover.dbc"))
    found = LayoutFound("DBC", layout, 50.0, "0x110")
    assert beside(found, tmp_path / "rover.toml").layout == layout.model_copy(update={"file": "maker/rover.dbc"})
    assert beside(found, tmp_path / "elsewhere" / "rover.toml") == found


@pytest.mark.parametrize("layout", [DbcLayout(), *PRESETS], ids=lambda layout: getattr(layout, "name", "infant"))
def test_how_far_each_wheel_counted_is_told_and_a_count_that_falls_gets_its_sign(
    layout: Layout, tmp_path: Path
) -> None:
    """Of motors that face each other, one counts backwards: without its sign the rover spins where it drives on."""
    forward = frames_of(layout)
    left, right = counts_heard(layout, forward) or (0.0, 0.0)
    assert left > 0.0
    assert right == pytest.approx(left, rel=0.05)
    assert counts_line((left, right)).endswith("both rise")
    assert "needs --reverse right" in counts_line((left, -right))
    assert counts_line((0.0, 0.0)).endswith("no wheel turned")
    assert counts_heard(layout, forward[:1]) is None
    path, said = tmp_path / "rover.toml", list[str]()
    told = replace(GEOMETRY, reversed_wheels=("right",))
    set_up(path, "r1", Known(bus="can0"), lambda: told, said.append, searching(forward))
    assert any(line.startswith("counts    left +") for line in said)
    found = load_configuration(path).encoders
    assert found is not None
    assert (found.left.sign, found.right.sign) == (1, -1)
