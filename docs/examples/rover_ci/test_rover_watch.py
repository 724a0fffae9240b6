"""Tests with simulated sensors, without hardware: install pytest, and Infant from its sources; then type `pytest`."""

import time

import can
from rover_watch import model_of

from runtime.api.simulated import SimulatedLaser, SimulatedRover, SimulatedWheels


def test_the_laser_says_what_it_is(simulated_laser: SimulatedLaser) -> None:
    model = model_of(simulated_laser.url, timeout_s=30.0)
    assert model is not None
    assert model.startswith("UTM-X001S")


def test_a_silent_laser_is_noticed_and_may_come_back(simulated_laser: SimulatedLaser) -> None:
    simulated_laser.fail("silence")
    assert model_of(simulated_laser.url, timeout_s=0.5) is None
    simulated_laser.recover()
    assert model_of(simulated_laser.url, timeout_s=30.0) is not None


def test_the_wheels_send_counts_on_the_bus(simulated_wheels: SimulatedWheels) -> None:
    bus = simulated_wheels.bus
    with can.Bus(interface=bus.interface, channel=bus.channel, port=bus.port) as listener:
        wanted = {0x181, 0x182}
        while wanted:
            message = listener.recv(30.0)
            assert message is not None, f"nothing heard of {wanted}"
            wanted.discard(message.arbitration_id)


def test_a_rover_that_drives_leaves_the_origin(simulated_rover: SimulatedRover) -> None:
    assert simulated_rover.true_pose(time.monotonic_ns()).x_m == 0.0
    simulated_rover.drive()
    later_ns = time.monotonic_ns() + 10_000_000_000
    assert simulated_rover.true_pose(later_ns).x_m > 1.0
