"""Simulated nodes speak every layout that the driver reads: what comes out is the way that the wheels rolled."""

import numpy as np
import pytest

from drivers.canbus.frame import CanFrame
from drivers.measurements import DriverError
from drivers.settings.encoders import EncoderSettings, WheelSettings
from drivers.settings.layouts import Cia406Layout, DbcLayout, Layout, PresetLayout
from drivers.settings.simulated_wheels import SimulatedWheelSettings, WheelFault
from drivers.settings.wheel_signals import WheelSignals
from drivers.simulated.wheels.encoder_nodes import EncoderNodes
from drivers.wheels.readings import Wheel
from runtime.source_tree import CONFIG
from tests.support.drivers.virtual_drive import VirtualDrive

STEERED = str(CONFIG / "examples" / "steered.dbc")
UNSIGNED = """VERSION ""
BU_: X
BO_ 256 LEFT: 8 X
 SG_ SPEED : 0|16@1+ (0.01,0) [0|0] "m/s" X
 SG_ BACKWARD : 16|1@1+ (1,0) [0|1] "" X
BO_ 257 RIGHT: 8 X
 SG_ SPEED : 0|16@1+ (0.01,0) [0|0] "m/s" X
BO_ 258 GEAR: 1 X
 SG_ DRIVE : 0|3@1+ (1,0) [0|7] "" X
"""


def preset(name: str) -> PresetLayout:
    return PresetLayout.model_validate({"kind": "preset", "name": name, "left_node": 1, "right_node": 2})


def of_one_message(file: str) -> DbcLayout:
    sides = [WheelSignals(message="WHEEL_SPEEDS", speed=f"SPEED_R{side}", speed_unit="kph") for side in "LR"]
    return DbcLayout(file=file, left=sides[0], right=sides[1])


LAYOUTS: dict[str, Layout] = {
    "infant": DbcLayout(),
    **{name: preset(name) for name in ("odrive", "odrive_counts", "vesc", "cia402")},
    "cia406": Cia406Layout(kind="cia406", left_node=5, right_node=6),
    "steered": of_one_message(STEERED),
}


def driven(encoders: EncoderSettings) -> VirtualDrive:
    drive = VirtualDrive(3, SimulatedWheelSettings(slip_std_per_m=0.0), encoders)
    drive.run(12.0)
    return drive


@pytest.mark.parametrize("name", LAYOUTS)
def test_the_driver_reads_the_way_that_the_wheels_rolled_forward_and_backward(name: str) -> None:
    drive = driven(EncoderSettings(layout=LAYOUTS[name], speed_tolerance_m=0.0))
    samples = [sample for sample in drive.samples if sample.valid]
    assert len(samples) > 500
    first, last = samples[0], samples[-1]
    way = np.subtract(drive.true_counts(last.stamp_ns), drive.true_counts(first.stamp_ns))
    error_m = np.abs((last.left - first.left, last.right - first.right) - way) / drive.encoders.counts_per_metre
    assert np.abs(way).max() / drive.encoders.counts_per_metre > 2.0
    assert error_m.max() < (0.02 if name == "steered" else 0.002)  # speeds of 0.01 km/h, at the ends of each period


@pytest.mark.parametrize("name", ["infant", "odrive", "cia402"])
def test_a_counter_that_falls_while_the_rover_drives_forward_is_turned_round(name: str) -> None:
    encoders = EncoderSettings(layout=LAYOUTS[name], speed_tolerance_m=0.0, right=WheelSettings(sign=-1))
    drive = driven(encoders)
    assert drive.samples[-1].right - drive.samples[0].right > 2.0 * encoders.counts_per_metre
    assert drive.wrong_motion_m() < 0.002


def test_a_speed_without_a_sign_comes_with_its_direction(tmp_path) -> None:  # type: ignore[no-untyped-def]
    file = tmp_path / "maker.dbc"
    file.write_text(UNSIGNED)
    left = WheelSignals(message="LEFT", speed="SPEED", speed_unit="mps", direction="BACKWARD")
    for right in ("GEAR.DRIVE", ""):
        both = WheelSignals(message="RIGHT", speed="SPEED", speed_unit="mps", direction=right)
        drive = driven(EncoderSettings(layout=DbcLayout(file=str(file), left=left, right=both)))
        way = drive.true_counts(drive.samples[-1].stamp_ns)[0] - drive.true_counts(drive.samples[0].stamp_ns)[0]
        error_m = (drive.samples[-1].left - drive.samples[0].left - way) / drive.encoders.counts_per_metre
        assert abs(error_m) < 0.06  # steps of 1 cm/s


def test_a_canopen_node_tells_that_it_lives_and_that_it_has_booted() -> None:
    encoders = EncoderSettings(layout=LAYOUTS["cia406"])
    nodes = EncoderNodes(SimulatedWheelSettings(), encoders, 0, np.random.default_rng(1))
    assert nodes.info(Wheel.LEFT, 7) == [CanFrame(7, 0x705, b"\x05")]
    nodes.inject(WheelFault(kind="power_cycle", duration_s=0.1), 0)
    nodes.beat(Wheel.LEFT, 20_000_000, 0.0)
    boot_up, position = nodes.beat(Wheel.LEFT, 200_000_000, 0.0)
    assert (boot_up.arbitration_id, boot_up.data) == (0x705, b"\x00")
    assert int.from_bytes(position.data[:4], "little") == 0


@pytest.mark.parametrize("fault", ["bad_crc", "alive_frozen", "wrong_counts_per_rev", "status"])
def test_a_fault_that_a_layout_has_no_signal_for_is_refused_by_name(fault: str) -> None:
    nodes = EncoderNodes(SimulatedWheelSettings(), EncoderSettings(layout=LAYOUTS["vesc"]), 0, np.random.default_rng(1))
    with pytest.raises(DriverError, match=f"{fault}.*choose another fault"):
        nodes.inject(WheelFault.model_validate({"kind": fault}), 0)


def test_a_fault_begins_at_its_time_and_slip_turns_the_wheel_farther_than_the_rover() -> None:
    faults = (WheelFault(kind="slip", share=0.5, start_s=1.0, duration_s=1.0),)
    nodes = EncoderNodes(
        SimulatedWheelSettings(faults=faults, slip_std_per_m=0.0), EncoderSettings(), 0, np.random.default_rng(1)
    )
    counts = []
    for beat in range(150):
        for wheel in Wheel:
            nodes.beat(wheel, beat * 20_000_000, beat * 0.01)
        counts.append((nodes.true_count(Wheel.LEFT), nodes.true_count(Wheel.RIGHT)))
    metres = np.array(counts)[[0, 49, 99, 149]] / EncoderSettings().counts_per_metre
    assert np.diff(metres, axis=0)[:, 0] == pytest.approx([0.49, 0.75, 0.5], abs=0.006)
    assert np.diff(metres, axis=0)[:, 1] == pytest.approx([0.49, 0.5, 0.5], abs=0.001)
