import math
import time

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.canbus.bus import CanBus
from drivers.canbus.frame import CanFrame
from drivers.settings.can import BusSettings
from drivers.settings.encoders import EncoderSettings
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.simulated.wheels.encoder_nodes import EncoderNodes
from drivers.simulated.wheels.node import WheelNode
from drivers.simulated.wheels.odometer import WheelOdometer
from drivers.wheels.layouts.choose import wheel_decoder
from drivers.wheels.readings import NodeInfo, Wheel, WheelReading
from tests.support.drivers.waiting import wait_until

FRAMES = wheel_decoder(EncoderSettings())
COUNTS_PER_METRE = EncoderSettings().counts_per_metre


def odometer(factor: float = 1.0, slip: float = 0.0, seed: int = 1) -> WheelOdometer:
    settings = SimulatedWheelSettings(slip_std_per_m=slip)
    return WheelOdometer(settings, factor, np.random.default_rng(seed))


def test_counts_are_whole_and_exact_without_slip() -> None:
    wheel = odometer()
    travels = np.linspace(0.0, 5.0, 400)
    assert [wheel.count(float(way)) for way in travels] == [math.floor(way * COUNTS_PER_METRE) for way in travels]


def test_a_larger_wheel_counts_less() -> None:
    assert odometer(1.02).count(10.0) == pytest.approx(10.0 * COUNTS_PER_METRE / 1.02, abs=1)


def test_slip_grows_with_the_root_of_the_way_whatever_the_step_and_never_at_rest() -> None:
    for step_m in (0.01, 0.1):
        ends = []
        for seed in range(300):
            wheel = odometer(slip=0.02, seed=seed)
            for count in range(round(4.0 / step_m)):
                wheel.count((count + 1) * step_m)
            ends.append(wheel.count(4.0) / COUNTS_PER_METRE - 4.0)
        assert np.std(ends) == pytest.approx(0.02 * math.sqrt(4.0), rel=0.15)
    wheel = odometer(slip=0.02)
    assert len({wheel.count(1.0) for _ in range(100)}) == 1


def nodes(**settings: object) -> EncoderNodes:
    return EncoderNodes(
        SimulatedWheelSettings.model_validate({"slip_std_per_m": 0.0, **settings}),
        EncoderSettings(),
        0,
        np.random.default_rng(1),
    )


def test_frames_start_near_the_top_wrap_and_carry_alive_and_boot_id() -> None:
    pair = nodes()
    readings = []
    for beat in range(40):
        (frame,) = pair.beat(Wheel.LEFT, beat * 20_000_000, beat * 0.02)
        (reading,) = FRAMES.decode(frame)
        assert isinstance(reading, WheelReading)
        readings.append(reading)
    assert readings[0].position == 0xFFFFFF00
    assert readings[-1].position == (0xFFFFFF00 + math.floor(39 * 0.02 * COUNTS_PER_METRE)) % 2**32
    assert [reading.alive for reading in readings] == [beat % 16 for beat in range(40)]
    assert {reading.boot_id for reading in readings} == {1}
    steps = np.diff([reading.position for reading in readings]) % 2**32
    assert [round(reading.speed or 0.0) // 50 for reading in readings[1:]] == steps.tolist()


def test_a_node_that_was_held_up_says_its_top_speed_and_not_that_it_has_none() -> None:
    pair = nodes()
    for stamp_ns, travel_m in ((0, 0.0), (500_000_000, 5.0), (1_000_000_000, -5.0)):
        (reading,) = FRAMES.decode(pair.beat(Wheel.LEFT, stamp_ns, travel_m)[0])
        assert isinstance(reading, WheelReading)


def test_a_power_cycle_begins_at_zero_with_the_next_boot_id_and_a_fresh_uptime() -> None:
    pair = nodes()
    pair.beat(Wheel.LEFT, 0, 0.0)
    pair.inject(fault("power_cycle", duration_s=0.1), 20_000_000)
    assert pair.beat(Wheel.LEFT, 40_000_000, 1.0) == []
    assert pair.info(Wheel.LEFT, 40_000_000) == []
    (frame,) = pair.beat(Wheel.LEFT, 140_000_000, 1.0)
    (reading,) = FRAMES.decode(frame)
    assert isinstance(reading, WheelReading)
    assert (reading.position, reading.boot_id, reading.alive) == (0, 2, 0)
    (info,) = FRAMES.decode(pair.info(Wheel.LEFT, 150_000_000)[0])
    assert info == NodeInfo(Wheel.LEFT, 4096, 20, 1, 10)


def fault(name: str, **values: object):  # type: ignore[no-untyped-def]
    from drivers.settings.simulated_wheels import WheelFault

    return WheelFault.model_validate({"kind": name, **values})


def test_faults_from_the_configuration_are_on_from_the_start_and_end_by_themselves() -> None:
    pair = nodes(faults=[{"kind": "silence", "wheel": "left", "duration_s": 0.05}])
    sent = [bool(pair.beat(Wheel.LEFT, beat * 20_000_000, 0.0)) for beat in range(6)]
    assert sent == [False, False, False, True, True, True]
    assert pair.beat(Wheel.RIGHT, 0, 0.0)


def test_a_misspelt_fault_is_refused_by_name() -> None:
    encoders = EncoderSettings(bus=BusSettings(interface="virtual", channel="none"))
    rng = np.random.default_rng(1)
    node = WheelNode(SimulatedWheelSettings(), encoders, lambda _: (0.0, 0.0), time.monotonic_ns, rng)
    with pytest.raises(ValidationError, match="silense"):
        node.inject({"kind": "silense"})


def test_the_same_seed_sends_the_same_bytes() -> None:
    def sent() -> list[CanFrame]:
        pair = EncoderNodes(SimulatedWheelSettings(), EncoderSettings(), 0, np.random.default_rng(7))
        return [frame for beat in range(50) for frame in pair.beat(Wheel.LEFT, beat * 20_000_000, beat * 0.03)]

    assert sent() == sent()


def test_a_node_on_a_bus_never_sends_faster_than_its_period_and_tells_what_it_is() -> None:
    bus = BusSettings(interface="virtual", channel="wheel node")
    settings = SimulatedWheelSettings(info_period_s=0.2)
    listener, encoders = CanBus(bus, (), time.monotonic_ns), EncoderSettings(bus=bus)
    rng = np.random.default_rng(1)
    node = WheelNode(settings, encoders, lambda t: (t * 1e-9, t * 1e-9), time.monotonic_ns, rng)
    node.start()
    frames: list[CanFrame] = []

    def hear() -> bool:
        frame = listener.receive(0.1)
        frames.extend([frame] if frame is not None else [])
        return sum(frame.arbitration_id == 0x701 for frame in frames) >= 4

    try:
        assert wait_until(hear)
    finally:
        node.close()
        listener.close()
    left = [frame.stamp_ns for frame in frames if frame.arbitration_id == 0x181]
    assert 4 <= len(left) <= (left[-1] - left[0]) / 20e6 + 2
    assert {frame.arbitration_id for frame in frames} == {0x181, 0x182, 0x701, 0x702}
