from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from drivers.canbus.frame import ERROR, CanFrame
from drivers.events import EventLog
from drivers.measurements import WheelCounts
from drivers.settings.encoders import EncoderSettings, WheelSettings
from drivers.settings.layouts import DbcLayout
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.wheels.layouts.choose import layout_messages, wheel_decoder
from drivers.wheels.layouts.messages import FeedbackMessage
from drivers.wheels.pair import WheelPair
from drivers.wheels.readings import Wheel, WheelDecoder
from tests.support.drivers.candump import read_candump
from tests.support.drivers.virtual_drive import FRAMES, SETTINGS, VirtualDrive

PERIOD_NS = 20_000_000
MESSAGES = layout_messages(DbcLayout())


def frame(wheel: Wheel, stamp_ns: int, beat: int, count: int, speed: int) -> CanFrame:
    signals = DbcLayout().left if wheel is Wheel.LEFT else DbcLayout().right
    feedback = FeedbackMessage(wheel, MESSAGES[signals.message], signals, 50.0)
    values = {
        signals.count: count % 2**32,
        signals.speed: speed,
        signals.alive: beat % 16,
        signals.boot_id: 3,
    }
    return feedback.encode(values, stamp_ns)


def run(pair: WheelPair, beats: int, skew_ns: int, speed: int = 200, first: int = 0) -> list[WheelCounts]:
    """Both wheels at the same steady speed, the right one skewed in time and counted at its own moment."""
    for beat in range(first, first + beats):
        pair.feed(frame(Wheel.LEFT, beat * PERIOD_NS, beat, speed * beat, speed))
        right = round(speed * (beat + skew_ns / PERIOD_NS))
        pair.feed(frame(Wheel.RIGHT, beat * PERIOD_NS + skew_ns, beat, right, speed))
    return list(pair.take())


@pytest.mark.parametrize("skew_ms", [0.7, 5.0, 10.0, 19.0])
def test_a_skew_between_the_wheels_is_no_turn(skew_ms: float) -> None:
    samples = run(WheelPair(SETTINGS, FRAMES), 50, round(skew_ms * 1e6))
    assert len(samples) >= 48
    differences = [sample.right - sample.left for sample in samples[1:]]
    # latest with latest would differ by up to 190 counts, 36 mm; rounding of the counts is all that is left
    assert max(differences) - min(differences) <= 1.0
    assert (samples[0].left, samples[0].right) == (0.0, 0.0)


def test_nothing_is_said_before_both_wheels_were_heard() -> None:
    pair = WheelPair(SETTINGS, FRAMES)
    for beat in range(20):
        pair.feed(frame(Wheel.LEFT, beat * PERIOD_NS, beat, 0, 0))
    pair.check(10**12)
    assert pair.take() == ()


def test_two_wheels_that_fall_silent_are_both_named() -> None:
    log = EventLog("encoders")
    pair = WheelPair(SETTINGS, FRAMES, log)
    run(pair, 50, 700_000)
    pair.check(50 * PERIOD_NS + 1_000_000_000)
    said = [event.reason.partition(":")[0] for event in log.drain() if event.kind == "invalid"]
    assert said == ["left wheel", "right wheel"]
    assert pair.trouble(50 * PERIOD_NS + 1_000_000_000).startswith("both wheels: silent")


def test_a_wheel_that_is_silent_makes_invalid_samples_and_the_other_is_not_used_alone() -> None:
    pair = WheelPair(SETTINGS, FRAMES)
    before = run(pair, 50, 700_000)[-1]
    for beat in range(50, 100):
        pair.feed(frame(Wheel.LEFT, beat * PERIOD_NS, beat, 200 * beat, 200))
    silent = pair.take()
    assert silent
    assert not any(sample.valid for sample in silent)
    assert all((sample.left, sample.right) == (before.left, before.right) for sample in silent)
    after = run(pair, 10, 700_000, first=100)
    assert after[-1].valid
    assert after[-1].left - before.left == pytest.approx(200 * 60, abs=201)
    assert after[-1].right - after[-1].left == pytest.approx(before.right - before.left, abs=1.0)


def test_the_sign_turns_a_counter_about() -> None:
    settings = EncoderSettings(right=WheelSettings(sign=-1))
    pair = WheelPair(settings, wheel_decoder(settings))
    last = run(pair, 50, 700_000)[-1]
    assert last.left > 0
    assert last.right == pytest.approx(-last.left, abs=10)


def test_a_wheel_that_stands_still_while_the_other_rolls_is_suspected_and_cleared() -> None:
    pair = WheelPair(SETTINGS, FRAMES)
    for beat in range(60):
        pair.feed(frame(Wheel.LEFT, beat * PERIOD_NS, beat, 0, 0))
        pair.feed(frame(Wheel.RIGHT, beat * PERIOD_NS + 1, beat, 200 * beat, 200))
    assert pair.left.stuck
    assert pair.left.counters["still"] == 1
    assert [event.kind for event in pair.events.drain()] == ["still"]
    for beat in range(60, 65):
        pair.feed(frame(Wheel.LEFT, beat * PERIOD_NS, beat, 50 * (beat - 60), 50 if beat > 60 else 0))
        pair.feed(frame(Wheel.RIGHT, beat * PERIOD_NS + 1, beat, 200 * beat, 200))
    assert not pair.left.stuck


def test_frames_of_both_wheels_missing_at_once_are_told_apart_from_a_node_s_fault() -> None:
    pair = WheelPair(SETTINGS, FRAMES)
    run(pair, 20, 700_000)
    run(pair, 20, 700_000, first=24)
    assert pair.left.counters["lost"] == pair.right.counters["lost"] == 4
    assert pair.events.counters["lost_together"] == 1


@pytest.mark.parametrize("seed", range(5))
def test_a_long_drive_without_faults_is_exact_through_the_wrap(seed: int) -> None:
    drive = VirtualDrive(seed, SimulatedWheelSettings(slip_std_per_m=0.05))
    drive.run(20.0)
    assert drive.pair.left.counters == drive.pair.right.counters == {"lost": 0}
    assert all(sample.valid for sample in drive.samples)
    assert drive.wrong_motion_m() < 0.001
    left, right = np.subtract(
        drive.true_counts(drive.samples[-1].stamp_ns), drive.true_counts(drive.samples[0].stamp_ns)
    )
    assert (drive.samples[-1].left, drive.samples[-1].right) == pytest.approx((left, right), abs=1.5)


def test_speeds_alone_are_integrated_and_a_gap_is_unknown_motion() -> None:
    from drivers.settings.layouts import SignalsLayout
    from drivers.settings.wheel_signals import MessageSettings, SignalSettings, WheelSignals

    wheel = WheelSignals(message="V", speed="l", speed_unit="mps")
    layout = SignalsLayout(
        messages=(
            MessageSettings(
                name="V",
                frame_id=0x100,
                length=4,
                signals=(
                    SignalSettings(name="l", start=0, length=16, type="signed", scale=0.001),
                    SignalSettings(name="r", start=16, length=16, type="signed", scale=0.001),
                ),
            ),
        ),
        left=wheel,
        right=wheel.model_copy(update={"speed": "r"}),
    )
    settings = EncoderSettings().model_copy(update={"layout": layout})
    frames: WheelDecoder = wheel_decoder(settings)
    pair = WheelPair(settings, frames)
    beats = [*range(51), *range(80, 131)]
    for beat in beats:
        speeds = (1000).to_bytes(2, "little") + (-500).to_bytes(2, "little", signed=True)
        pair.feed(CanFrame(beat * PERIOD_NS, 0x100, speeds))
    samples = pair.take()
    first = [sample for sample in samples if sample.stamp_ns <= 50 * PERIOD_NS][-1]
    assert first.left / settings.counts_per_metre == pytest.approx(1.0)
    assert first.right / settings.counts_per_metre == pytest.approx(-0.5)
    assert any(not sample.valid for sample in samples)
    assert samples[-1].left / settings.counts_per_metre == pytest.approx(2.0)
    assert pair.left.counters["lost"] == 29


def test_a_recorded_drive_gives_the_counts_that_its_first_and_last_lines_say(
    recorded_data: Callable[[str], Path],
) -> None:
    pair = WheelPair(SETTINGS, FRAMES)
    for frame in read_candump(recorded_data("can_encoder") / "infant_candump.log"):
        if not frame.flags & ERROR:
            pair.feed(frame)
    last = pair.take()[-1]
    # 0xFFFFFF00 to 0x471F through the wrap; the last frame of the left wheel comes first and waits for the right one's
    assert (last.left, last.right) == pytest.approx((0x471F + 0x100,) * 2, abs=37)
    assert pair.left.counters["lost"] == pair.right.counters["lost"] == 0


def test_wheels_that_send_500_times_a_second_bear_a_reader_that_is_held_up() -> None:
    settings = EncoderSettings(period_ms=2.0)
    assert (settings.degraded_ns, settings.silent_ns) == (60_000_000, 200_000_000)
    pair = WheelPair(settings, wheel_decoder(settings))
    for beat in range(100, 1000):
        read = beat - beat % 100 + max(beat % 100, 20)  # twenty in a bunch, 40 ms after the first of them was sent
        for wheel in Wheel:
            pair.feed(frame(wheel, read * 2_000_000, beat, 5 * beat, 5))
        pair.check(read * 2_000_000)
    samples = [sample for sample in pair.take() if sample.stamp_ns > 300_000_000]
    assert all(sample.valid for sample in samples)
    assert samples[-1].left - samples[0].left == pytest.approx(5 * (999 - 150), abs=100)
