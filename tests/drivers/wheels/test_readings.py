import math
import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from cantools.database.can import Database
from crccheck.crc import Crc
from hypothesis import given
from hypothesis import strategies as st

from drivers.canbus.frame import EXTENDED, FD, REMOTE, CanFrame
from drivers.measurements import DriverError
from drivers.settings.encoders import EncoderSettings, WheelSettings
from drivers.settings.layouts import Cia406Layout, DbcLayout, PresetLayout, SignalsLayout
from drivers.settings.vehicle import VehicleSettings
from drivers.settings.wheel_signals import MessageSettings, SignalSettings, WheelSignals
from drivers.wheels.layouts.choose import layout_messages, wheel_decoder
from drivers.wheels.layouts.messages import FeedbackMessage, InfoMessage
from drivers.wheels.pair import WheelPair
from drivers.wheels.readings import NodeAlarm, NodeInfo, NodeState, Refused, Wheel, WheelReading
from tests.support.drivers.candump import read_candump
from tests.support.examples import examples

LAYOUT = DbcLayout()
MESSAGES = layout_messages(LAYOUT)
FRAMES = wheel_decoder(EncoderSettings())
KPH = 1.0 / 3.6


def civic(folder: Path) -> EncoderSettings:
    wheel = WheelSignals(message="WHEEL_SPEEDS", speed="WHEEL_SPEED_RL", speed_unit="kph")
    return EncoderSettings(
        layout=DbcLayout(
            file=str(folder / "wheel.dbc"),
            left=wheel,
            right=wheel.model_copy(update={"speed": "WHEEL_SPEED_RR"}),
        ),
        period_ms=20.0,
        vehicle=VehicleSettings(max_speed_mps=60.0),
    )


def test_the_checksum_is_the_one_of_sae_j1850() -> None:
    signals = LAYOUT.left.model_copy(update={"crc_over_id": False})
    feedback = FeedbackMessage(Wheel.LEFT, MESSAGES[signals.message], signals, 1.0)
    place = len(feedback.encode({}).data) - 1  # the checksum's own byte is left out
    assert feedback.checksum(b"123456789"[:place] + b"?" + b"123456789"[place:]) == 0x4B


@given(
    count=st.integers(0, 2**32 - 1),
    speed=st.integers(-2047, 2046),  # the ends say that there is none
    status=st.integers(0, 15),
    alive=st.integers(0, 15),
    boot=st.integers(0, 15),
)
def test_what_is_packed_is_unpacked(count: int, speed: int, status: int, alive: int, boot: int) -> None:
    for wheel, signals in ((Wheel.LEFT, LAYOUT.left), (Wheel.RIGHT, LAYOUT.right)):
        feedback = FeedbackMessage(wheel, MESSAGES[signals.message], signals, 50.0)
        values = {signals.count: count, signals.speed: speed, signals.status: status}
        frame = feedback.encode({**values, signals.alive: alive, signals.boot_id: boot})
        (reading,) = FRAMES.decode(frame)
        expected = WheelReading(wheel, count, speed * 50.0, status, status == 0, alive, boot)
        assert reading == expected._replace(is_sentinel=count == 2**32 - 1)


@pytest.mark.parametrize("speed", [-2048, 2047])
def test_a_speed_that_means_that_there_is_none_is_refused(speed: int) -> None:
    feedback = FeedbackMessage(Wheel.LEFT, MESSAGES[LAYOUT.left.message], LAYOUT.left, 50.0)
    assert FRAMES.decode(feedback.encode({LAYOUT.left.speed: speed})) == (Refused(Wheel.LEFT, "not_available"),)


@given(bit=st.integers(0, 63))
def test_one_flipped_bit_is_refused(bit: int) -> None:
    data = bytearray.fromhex("00FFFFFF25001082")
    data[bit // 8] ^= 1 << bit % 8
    assert FRAMES.decode(CanFrame(0, 0x181, bytes(data))) == (Refused(Wheel.LEFT, "crc"),)


def test_the_checksum_covers_the_id_so_that_left_is_never_right() -> None:
    assert FRAMES.decode(CanFrame(0, 0x182, bytes.fromhex("00FFFFFF25001082"))) == (Refused(Wheel.RIGHT, "crc"),)


@pytest.mark.parametrize(
    ("data", "flags", "reason"),
    [
        ("00FFFFFF250010", 0, "length"),
        ("00FFFFFF2500108200", 0, "length"),
        ("", REMOTE, "remote"),
        ("00FFFFFF25001082", FD, "fd"),
        ("00FFFFFF25001082", EXTENDED, "extended"),
    ],
)
def test_a_frame_in_another_form_is_refused_with_its_reason(data: str, flags: int, reason: str) -> None:
    assert FRAMES.decode(CanFrame(0, 0x181, bytes.fromhex(data), flags)) == (Refused(Wheel.LEFT, reason),)


def test_frames_of_others_are_nothing() -> None:
    assert FRAMES.decode(CanFrame(0, 0x123, bytes(8))) == ()


def test_the_slow_message_survives_the_round_trip() -> None:
    assert LAYOUT.right.info is not None
    info = InfoMessage(Wheel.RIGHT, MESSAGES[LAYOUT.right.info.message], LAYOUT.right.info)
    said = NodeInfo(Wheel.RIGHT, 4096, 20, 1, 123_456)
    assert FRAMES.decode(info.encode(said)) == (said,)


def test_every_frame_of_the_reference_candump_is_good_but_its_error_frame(
    recorded_data: Callable[[str], Path],
) -> None:
    log = recorded_data("can_encoder") / "infant_candump.log"
    decoded = [item for frame in read_candump(log) for item in FRAMES.decode(frame)]
    assert len(decoded) == 1000
    assert all(isinstance(item, WheelReading) for item in decoded)


def test_the_real_vehicle_s_wheel_speeds_equal_cantools_own_and_gaps_are_reported(
    recorded_data: Callable[[str], Path],
) -> None:
    folder = recorded_data("can_civic_typer")
    settings = civic(folder)
    frames = wheel_decoder(settings)
    database = Database()
    database.add_dbc_file(str(folder / "wheel.dbc"))
    pair = WheelPair(settings, frames)
    seen = 0
    for frame in read_candump(folder / "candump.log"):
        pair.feed(frame)
        decoded = frames.decode(frame)
        if not decoded:
            continue
        seen += 1
        own = database.decode_message(frame.arbitration_id, frame.data)
        assert isinstance(own, dict)
        for reading, name in zip(decoded, ("WHEEL_SPEED_RL", "WHEEL_SPEED_RR"), strict=True):
            assert isinstance(reading, WheelReading)
            assert reading.speed is not None
            speed = own[name]
            assert isinstance(speed, float)
            assert reading.speed / settings.counts_per_metre == pytest.approx(speed * KPH, abs=1e-9)
    assert seen == 803
    samples = pair.take()
    # the car sends every 20 ms; the recording has holes of up to 10 s
    assert pair.left.counters["lost"] == pair.right.counters["lost"] == 2476
    assert pair.left.counters["gap"] == 54
    assert {"gap", "invalid", "lost_together"} <= {event.kind for event in pair.events.drain()}
    assert sum(not sample.valid for sample in samples) >= 54


def test_both_wheels_may_share_a_message_and_each_gets_its_refusal() -> None:
    message = MessageSettings(
        name="BOTH",
        frame_id=0x200,
        signals=(SignalSettings(name="l", start=0, length=16), SignalSettings(name="r", start=16, length=16)),
    )
    both = SignalsLayout(
        messages=(message,),
        left=WheelSignals(message="BOTH", count="l"),
        right=WheelSignals(message="BOTH", count="r"),
    )
    frames = wheel_decoder(EncoderSettings().model_copy(update={"layout": both}))
    readings = frames.decode(CanFrame(0, 0x200, struct.pack("<HHI", 7, 9, 0)))
    assert [reading.position for reading in readings if isinstance(reading, WheelReading)] == [7, 9]
    assert frames.modulus == {Wheel.LEFT: 65536, Wheel.RIGHT: 65536}
    assert frames.decode(CanFrame(0, 0x200, b"")) == (
        Refused(Wheel.LEFT, "length"),
        Refused(Wheel.RIGHT, "length"),
    )


def preset(name: str) -> EncoderSettings:
    layout = PresetLayout.model_validate({"kind": "preset", "name": name, "left_node": 1, "right_node": 2})
    return EncoderSettings(layout=layout)


def test_odrive_s_turns_become_counts() -> None:
    frames = wheel_decoder(preset("odrive"))
    (reading,) = frames.decode(CanFrame(0, 2 << 5 | 9, struct.pack("<ff", -12.5, 1.5)))
    assert reading == WheelReading(Wheel.RIGHT, -12.5 * 4096, 1.5 * 4096)
    assert frames.modulus[Wheel.RIGHT] == 0


def test_odrive_s_shadow_count_is_signed_and_wraps_at_32_bits() -> None:
    frames = wheel_decoder(preset("odrive_counts"))
    (reading,) = frames.decode(CanFrame(0, 1 << 5 | 0x0A, struct.pack("<ii", -5, 4091)))
    assert reading == WheelReading(Wheel.LEFT, -5)
    assert frames.modulus[Wheel.LEFT] == 2**32


def test_vesc_s_tachometer_is_big_endian_with_a_29_bit_id() -> None:
    frames = wheel_decoder(preset("vesc"))
    data = struct.pack(">ihh", -123456, 481, 0)
    assert frames.decode(CanFrame(0, 27 << 8 | 2, data, EXTENDED)) == (WheelReading(Wheel.RIGHT, -123456),)
    assert frames.decode(CanFrame(0, 27 << 8 | 2, data)) == (Refused(Wheel.RIGHT, "standard"),)


def test_cia402_s_fault_bit_makes_the_position_bad() -> None:
    frames = wheel_decoder(preset("cia402"))
    for statusword, good in ((0x0237, True), (0x0238, False)):
        (reading,) = frames.decode(CanFrame(0, 0x181, struct.pack("<Hi", statusword, 1000)))
        assert isinstance(reading, WheelReading)
        assert (reading.position, reading.status_ok) == (1000, good)


def test_cia406_takes_ids_mapping_and_range_from_the_eds() -> None:
    pytest.importorskip("canopen", reason="the extra canopen is not installed")
    frames = wheel_decoder(EncoderSettings(layout=Cia406Layout(kind="cia406", left_node=5, right_node=6)))
    assert frames.decode(CanFrame(0, 0x185, struct.pack("<Ih", 0x0FFFFFFF, -3))) == (
        WheelReading(Wheel.LEFT, 0x0FFFFFFF),
    )
    assert frames.modulus == {Wheel.LEFT: 0x10000000, Wheel.RIGHT: 0x10000000}
    assert frames.decode(CanFrame(0, 0x706, b"\0")) == (NodeState(Wheel.RIGHT, 0),)
    alarm = CanFrame(0, 0x085, struct.pack("<HB5x", 0x5530, 1))
    assert frames.decode(alarm) == (NodeAlarm(Wheel.LEFT, 0x5530),)
    assert [frame.data for frame in frames.wake_up] == [b"\x01\x05", b"\x01\x06"]


def test_a_boot_up_or_an_alarm_breaks_the_track_and_recovery_is_by_heartbeat() -> None:
    pytest.importorskip("canopen", reason="the extra canopen is not installed")
    settings = EncoderSettings(layout=Cia406Layout(kind="cia406", left_node=5, right_node=6))
    pair = WheelPair(settings, wheel_decoder(settings))
    count = {0x185: 0x0FFFFF00, 0x186: 500}

    def run(first: int, beats: int) -> None:
        for beat in range(first, first + beats):
            for number in count:
                count[number] += 40
                data = struct.pack("<Ih", count[number] % 0x10000000, 40)
                pair.feed(CanFrame(beat * 20_000_000 + number, number, data))

    run(0, 50)
    before = pair.take()[-1]
    assert (before.left, before.right) == pytest.approx((49 * 40, 49 * 40), abs=1)
    pair.feed(CanFrame(50 * 20_000_000, 0x705, b"\0"))
    assert pair.left.wake_up_wanted
    count[0x185] = 0
    run(51, 50)
    after = pair.take()
    assert not after[0].valid
    assert after[-1].valid
    assert after[-1].left - before.left == pytest.approx(49 * 40, abs=41)
    pair.feed(CanFrame(101 * 20_000_000, 0x085, struct.pack("<HB5x", 0x5530, 1)))
    run(102, 20)
    assert not any(sample.valid for sample in pair.take())
    assert "0x5530" in pair.trouble(122 * 20_000_000)
    pair.feed(CanFrame(122 * 20_000_000, 0x085, bytes(8)))
    run(123, 5)
    assert pair.take()[-1].valid
    assert pair.left.counters["emergency"] == 1


def test_a_missing_canopen_is_said_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "canopen", None)
    with pytest.raises(DriverError, match=r"pip install 'infant\[canopen\]'"):
        wheel_decoder(EncoderSettings(layout=Cia406Layout(kind="cia406", left_node=5, right_node=6)))


@pytest.mark.parametrize(
    ("update", "sentence"),
    [
        ({"message": "WHEEL_X_FB"}, "message WHEEL_X_FB: there is only WHEEL_L_FB, WHEEL_R_FB"),
        ({"count": "X_Count"}, "signal X_Count: message WHEEL_L_FB has only L_Count, L_Speed"),
        ({"crc": "L_Speed"}, "a checksum must be one whole byte"),
        ({"frame_id": 0x182}, "two messages with id 0x182"),
        ({"count": ""}, "one wheel has a count and the other only a speed"),
    ],
)
def test_a_layout_that_names_what_is_not_there_is_refused(update: dict[str, object], sentence: str) -> None:
    left = LAYOUT.left.model_copy(update=update)
    with pytest.raises(DriverError, match=sentence):
        wheel_decoder(EncoderSettings(layout=DbcLayout(left=left)))


def test_a_missing_file_is_named() -> None:
    with pytest.raises(DriverError, match=r"nowhere\.dbc: cannot be read"):
        wheel_decoder(EncoderSettings(layout=DbcLayout(file="nowhere.dbc")))


def test_modulus_comes_from_the_configuration_where_it_is_given() -> None:
    settings = EncoderSettings(left=WheelSettings(modulus=9000))
    assert wheel_decoder(settings).modulus == {Wheel.LEFT: 9000, Wheel.RIGHT: 2**32}


def test_counts_per_metre_follow_from_radius_and_counts_per_turn() -> None:
    assert EncoderSettings().counts_per_metre == pytest.approx(4096 / (2 * math.pi * 0.125))


@given(
    polynomial=st.integers(1, 255),
    init=st.integers(0, 255),
    xor_out=st.integers(0, 255),
    over_id=st.booleans(),
    data=st.binary(min_size=8, max_size=8),
)
@examples(60)
def test_any_checksum_is_the_one_that_the_library_finds(
    polynomial: int, init: int, xor_out: int, over_id: bool, data: bytes
) -> None:
    changes = {"crc_polynomial": polynomial, "crc_init": init, "crc_xor_out": xor_out, "crc_over_id": over_id}
    signals = LAYOUT.left.model_copy(update=changes)
    feedback = FeedbackMessage(Wheel.LEFT, MESSAGES[signals.message], signals, 1.0)
    id_bytes = feedback.arbitration_id.to_bytes(2, "little") if over_id else b""
    expected = Crc(8, polynomial, init, xor_output=xor_out).calc(id_bytes + data[:7])
    assert feedback.checksum(data) == expected
