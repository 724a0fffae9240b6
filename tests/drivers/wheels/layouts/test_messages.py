"""What a frame says beside a plain count: directions, multiplexed counts, units, ranges, and values that are none."""

import math
import struct
from pathlib import Path

import numpy as np
import pytest

from drivers.canbus.frame import CanFrame
from drivers.settings.encoders import EncoderSettings
from drivers.settings.vehicle import VehicleSettings
from drivers.settings.wheel_signals import MessageSettings, SignalSettings, WheelSignals
from drivers.wheels.layouts.routes import built_message, counts_per_s_of
from drivers.wheels.layouts.signals import quantity
from drivers.wheels.pair import WheelPair
from drivers.wheels.readings import Refused, Wheel, WheelReading
from tests.support.drivers.dbc import COUNTS, HEAD, feed, message, plain, turned_counts, wheels

FORWARD, REVERSE, UNKNOWN = 0, 1, 3
UNSIGNED = "S : 0|16@1+ (0.01,0) [0|0]"
BIT = "D : 16|2@1+ (1,0) [0|0]"


def speeds(tmp_path: Path, direction: str, extra: str = "") -> WheelPair:
    """Wheels that send a speed in hundredths of m/s without a sign."""
    text = HEAD + "".join(message(512 + k, name, UNSIGNED, BIT) for k, name in enumerate(("LW", "RW"))) + extra
    each = {"speed": "S", "speed_unit": "mps", "direction": direction}
    return wheels(tmp_path, text, {"message": "LW", **each}, {"message": "RW", **each})


def drive(pair: WheelPair, beats: range, way: int, gear: bool = False) -> None:
    for beat in beats:
        if gear:
            pair.feed(CanFrame(beat * 20_000_000 - 1, 600, bytes([way]).ljust(8, b"\0")))
        for number in (512, 513):
            feed(pair, beat, number, struct.pack("<HB", 50, 0 if gear else way))


@pytest.mark.parametrize("gear", [False, True])
def test_driving_backwards_counts_backwards_whoever_tells_the_direction(tmp_path: Path, gear: bool) -> None:
    extra = message(600, "GEAR", "D : 0|2@1+ (1,0) [0|0]")
    pair = speeds(tmp_path, "GEAR.D" if gear else "D", extra)
    drive(pair, range(100), FORWARD, gear)
    forward = pair.take()[-1].left
    drive(pair, range(100, 200), REVERSE, gear)
    back = pair.take()[-1].left
    assert forward == pytest.approx(0.5 * 2.0 * 5215.19, rel=0.02)
    assert back == pytest.approx(0.0, abs=120.0)


def test_a_direction_that_nobody_tells_is_motion_that_nobody_knows(tmp_path: Path) -> None:
    pair = speeds(tmp_path, "D")
    drive(pair, range(50), FORWARD)
    before = pair.take()[-1].left
    drive(pair, range(50, 100), UNKNOWN)
    assert "nothing says which way" in pair.trouble(100 * 20_000_000)
    drive(pair, range(100, 150), FORWARD)
    samples = pair.take()
    assert any(not sample.valid for sample in samples)
    assert samples[-1].left == pytest.approx(2.0 * before, rel=0.05)


def test_a_gear_that_falls_silent_is_not_believed_for_ever(tmp_path: Path) -> None:
    pair = speeds(tmp_path, "GEAR.D", message(600, "GEAR", "D : 0|2@1+ (1,0) [0|0]"))
    drive(pair, range(10), FORWARD, gear=True)
    for beat in range(10, 200):
        for number in (512, 513):
            feed(pair, beat, number, struct.pack("<HB", 50, 0))
    assert pair.left.counters["direction"] > 0


def test_pulses_that_only_rise_fall_with_the_direction(tmp_path: Path) -> None:
    text = HEAD + "".join(message(512 + k, name, "P : 0|16@1+ (1,0) [0|0]", BIT) for k, name in enumerate(("LW", "RW")))
    each = {"count": "P", "direction": "D"}
    pair = wheels(tmp_path, text, {"message": "LW", **each}, {"message": "RW", **each})
    for beat in range(200):
        for number in (512, 513):
            feed(pair, beat, number, struct.pack("<HB", 50 * beat, FORWARD if beat < 100 else REVERSE))
    assert pair.take()[-1].left == pytest.approx(0.0, abs=101.0)


def test_a_wheel_whose_speed_has_no_sign_is_told(tmp_path: Path) -> None:
    text = HEAD + message(512, "LW", UNSIGNED) + message(513, "RW", "S : 0|16@1- (0.01,0) [0|0]")
    each = {"speed": "S", "speed_unit": "mps"}
    pair = wheels(tmp_path, text, {"message": "LW", **each}, {"message": "RW", **each})
    assert pair._frames.unsigned == (Wheel.LEFT,)
    assert speeds(tmp_path, "D")._frames.unsigned == ()


def test_one_id_may_carry_both_counts_by_a_multiplexer(tmp_path: Path) -> None:
    signals = ("M M : 0|8@1+ (1,0) [0|0]", "L m0 : 8|32@1- (1,0) [0|0]", "R m1 : 8|32@1- (1,0) [0|0]")
    alive = "A : 40|4@1+ (1,0) [0|0]"
    pair = wheels(
        tmp_path,
        HEAD + message(512, "BOTH", *signals, alive),
        {"message": "BOTH", "count": "L", "alive": "A"},
        {"message": "BOTH", "count": "R", "alive": "A"},
    )
    for beat in range(100):
        for wheel in (0, 1):
            data = struct.pack("<BiB", wheel, 10 * beat * (1 + wheel), (2 * beat + wheel) % 16)
            pair.feed(CanFrame(beat * 20_000_000 + wheel * 10_000_000, 512, data.ljust(8, b"\0")))
    last = pair.take()[-1]
    assert last.left == pytest.approx(980, abs=11)
    assert last.right == pytest.approx(1970, abs=21)
    assert pair.left.counters["lost"] == 0


def test_a_multiplexer_value_that_the_layout_lacks_costs_that_frame(tmp_path: Path) -> None:
    signals = ("M M : 0|8@1+ (1,0) [0|0]", "T m1 : 8|8@1+ (1,0) [0|0]", "Cnt : 32|32@1- (1,0) [0|0]")
    text = HEAD + "".join(message(512 + k, name, *signals) for k, name in enumerate(("LW", "RW")))
    pair = plain(tmp_path, text)
    for beat in range(100):
        for number in (512, 513):
            feed(pair, beat, number, bytes([3 if beat == 50 else 1, 0, 0, 0]) + struct.pack("<i", 10 * beat))
    assert pair.left.counters["undecodable"] == 1
    assert pair.take()[-1].left == pytest.approx(989.5, abs=0.6)


def test_turns_a_minute_are_a_unit(tmp_path: Path) -> None:
    text = HEAD + "".join(message(512 + k, n, "S : 0|16@1- (0.1,0) [0|0]") for k, n in enumerate(("LW", "RW")))
    each = {"speed": "S", "speed_unit": "rpm"}
    pair = wheels(tmp_path, text, {"message": "LW", **each}, {"message": "RW", **each})
    for beat in range(51):
        for number in (512, 513):
            feed(pair, beat, number, struct.pack("<h", 600))  # one turn a second
    assert pair.take()[-1].left == pytest.approx(4096.0, rel=0.002)


def test_a_signal_may_have_an_offset() -> None:
    signal = SignalSettings(name="s", start=0, length=16, scale=0.5, offset=-100.0)
    made = built_message(MessageSettings(name="M", frame_id=1, signals=(signal,)))
    assert quantity(made, "s", 2.0).value(300) == 100.0


FLOAT = (
    HEAD
    + "".join(
        message(512 + k, name, "S : 0|32@1- (1,0) [0|0]", "P : 32|32@1- (1,0) [0|0]")
        for k, name in enumerate(("LW", "RW"))
    )
    + "".join(f"SIG_VALTYPE_ {512 + k} {name} : 1;\n" for k in (0, 1) for name in "SP")
)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("signals", [{"speed": "S", "speed_unit": "mps"}, {"count": "P", "speed": "S"}, {"count": "P"}])
def test_what_is_no_number_is_refused_and_leaves_no_trace(tmp_path: Path, bad: float, signals: dict[str, str]) -> None:
    pair = wheels(tmp_path, FLOAT, {"message": "LW", **signals}, {"message": "RW", **signals}, speed_tolerance_m=0.0)
    for beat in range(100):
        for number in (512, 513):
            value = bad if (beat, number) == (50, 512) else 0.5
            feed(pair, beat, number, struct.pack("<ff", value, value if value is bad else 100.0 * beat))
    assert pair.left.counters["not_finite"] == 1
    samples = pair.take()
    assert all(math.isfinite(sample.left) for sample in samples)
    assert samples[-1].valid
    assert samples[-1].left == pytest.approx(samples[-1].right, rel=0.03)


def test_a_value_outside_of_the_range_of_the_dbc_is_refused(tmp_path: Path) -> None:
    pair = plain(tmp_path, COUNTS.replace("[0|0]", "[-1000|1000]"))
    frames = pair._frames
    (reading,) = frames.decode(CanFrame(0, 512, struct.pack("<ii", 1000, 0)))
    assert isinstance(reading, WheelReading)
    assert frames.decode(CanFrame(0, 512, struct.pack("<ii", 1001, 0))) == (Refused(Wheel.LEFT, "out_of_range"),)


UNSIGNED_COUNTS = COUNTS.replace("@1-", "@1+")


@pytest.mark.parametrize(
    ("text", "code", "begins"),
    [
        (UNSIGNED_COUNTS, b"\xff\xff\xff\xff", 0),
        (UNSIGNED_COUNTS, b"\xff\xff\xff\xff", 100),
        (UNSIGNED_COUNTS, b"\x00\x00\x00\xfe", 100),
        (COUNTS, b"\x00\x00\x00\x80", 0),
        (COUNTS, b"\x00\x00\x00\x80", 100),
        (COUNTS, b"\x00\x00\x00\x00", 100),
        (COUNTS, b"\x87\xd6\x12\x00", 100),
    ],
)
def test_a_code_in_place_of_a_count_is_no_turn(tmp_path: Path, text: str, code: bytes, begins: int) -> None:
    pair = plain(tmp_path, text)
    for beat in range(400):
        count = struct.pack("<i", 6000 + 52 * beat)  # 0.5 m/s
        feed(pair, beat, 512, code if begins <= beat < begins + 150 else count)
        feed(pair, beat, 513, count)
    samples = pair.take()
    assert abs(turned_counts(samples)) < 0.05 * 0.5 * 5215.0
    assert samples[-1].valid


NARROW_COUNTS = COUNTS.replace("0|32@1-", "0|16@1+")


def test_a_code_that_lasts_until_a_narrow_counter_may_have_wrapped_is_no_wheel_at_rest(tmp_path: Path) -> None:
    pair = plain(tmp_path, NARROW_COUNTS)
    for beat in range(600):
        count = struct.pack("<H", 6000 + 52 * beat)
        feed(pair, beat, 512, b"\xa0\xe0" if 100 <= beat < 400 else count)
        feed(pair, beat, 513, count)
    samples = pair.take()
    assert abs(turned_counts(samples)) < 0.05 * 0.5 * 5215.0
    assert samples[-1].valid


@pytest.mark.parametrize("seed", range(8))
def test_a_count_that_fits_by_chance_among_noise_is_no_turn(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    pair = plain(tmp_path, NARROW_COUNTS)
    for beat in range(400):
        count = struct.pack("<H", 6000 + 52 * beat)
        feed(pair, beat, 512, rng.bytes(2) if 100 <= beat < 250 else count)
        feed(pair, beat, 513, count)
    samples = pair.take()
    assert abs(turned_counts(samples)) < 0.25 * 5215.0  # as far as a wheel turns in four periods
    assert samples[-1].valid


def test_a_count_may_pass_the_value_that_means_not_available(tmp_path: Path) -> None:
    pair = plain(tmp_path, UNSIGNED_COUNTS)
    for beat in range(100):
        for number in (512, 513):
            feed(pair, beat, number, struct.pack("<I", (beat - 50) % 2**32))  # from -50, and over -1
    assert pair.left.counters["not_available"] == 0
    assert pair.take()[-1].left == pytest.approx(99.0, abs=0.1)


@pytest.mark.parametrize("unit", ["mps", "kph"])
def test_a_calibrated_radius_scales_a_speed_in_metres_and_the_ratio_of_both_wheels_too(unit: str) -> None:
    drawn_m, left_m, right_m = 0.2, 0.206, 0.202
    signals = WheelSignals(message="V", speed="S", speed_unit=unit, counts_per_unit=4096 / (2.0 * math.pi * drawn_m))
    told_mps = 1.2
    way_m = []
    for left, right in ((drawn_m, drawn_m), (left_m, right_m)):
        vehicle = VehicleSettings(wheel_radius_left_m=left, wheel_radius_right_m=right)
        settings = EncoderSettings(vehicle=vehicle)
        counts_per_s = told_mps * (3.6 if unit == "kph" else 1.0) * counts_per_s_of(signals, settings)
        way_m.append([counts_per_s * 2.0 * math.pi * radius_m / vehicle.counts_per_rev for radius_m in (left, right)])
    assert way_m[0] == pytest.approx([told_mps, told_mps])
    assert way_m[1] == pytest.approx([told_mps * left_m / drawn_m, told_mps * right_m / drawn_m])
