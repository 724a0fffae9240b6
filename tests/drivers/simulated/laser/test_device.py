"""The simulated laser against clients over the real wire, one of them written by nobody here."""

import socket
import threading
import time

import numpy as np
import pytest
from hokuyolx import HokuyoLX

from drivers.measurements import LinkError
from drivers.scip.codec import parse_key_values, parse_message, parse_time
from drivers.scip.framing import MessageStream
from drivers.settings.simulated_laser import LaserFault, SimulatedLaserSettings
from drivers.simulated.laser.device import LaserDevice
from tests.support.drivers.laser_bench import NoisyRoom, simulated_laser, wait_for


class Client:
    """A plain SCIP client: sends lines, collects messages."""

    def __init__(self, device: LaserDevice) -> None:
        host, _, port = device.url.removeprefix("tcp://").partition(":")
        self.socket = socket.create_connection((host, int(port)), 2.0)
        self._stream = MessageStream()
        self._messages: list[bytes] = []

    def send(self, text: bytes) -> None:
        self.socket.sendall(text)

    def message(self) -> bytes:
        while not self._messages:
            data = self.socket.recv(65536)
            assert data, "the laser hung up"
            self._messages += [raw.data for raw in self._stream.feed(0, data)]
        return self._messages.pop(0)

    def ask(self, command: bytes) -> bytes:
        self.send(command + b"\n")
        return self.message()

    def close(self) -> None:
        self.socket.close()


def address_of(device: LaserDevice) -> tuple[str, int]:
    host, _, port = device.url.removeprefix("tcp://").partition(":")
    return host, int(port)


@pytest.mark.parametrize("scans", [20, pytest.param(1000, marks=pytest.mark.soak)])
def test_a_client_that_nobody_here_wrote_reads_parameters_and_streams_without_error(scans: int) -> None:
    # 10 Hz: this client breaks when two scans have come before it reads, which on a busy machine happens at 40 Hz
    with simulated_laser(SimulatedLaserSettings(model="UST-10LX", speed_rpm=600)) as (device, _):
        laser = HokuyoLX(addr=address_of(device), tsync=False, convert_time=False)
        assert (laser.dmin, laser.dmax, laser.ares, laser.amax, laser.scan_freq) == (20, 30000, 1440, 1080, 10)
        assert laser.version()["PROD"] == "SOKUIKI Sensor UST-10LX"
        assert laser.laser_state()[0] == 3
        stamps: list[int] = []
        for scan, stamp, remaining in laser.iter_dist(scans=0):
            assert scan.shape == (1081,)
            assert np.abs(scan[1:] - 5000.0).max() < 100
            assert remaining == 0
            stamps.append(stamp)
            if len(stamps) == scans:
                break
        laser.close()
    assert np.median(np.diff(stamps)) == 100


def test_a_client_that_nobody_here_wrote_measures_once_with_intensity_and_adjusts_time() -> None:
    with simulated_laser(SimulatedLaserSettings(model="UST-10LX")) as (device, _):
        laser = HokuyoLX(addr=address_of(device), tsync=False, convert_time=False)
        laser.time_sync(N=2, dt=0.01)
        laser.activate()
        _, ranges = laser.get_dist()
        _, pairs = laser.get_intens()
        taken = list(laser.iter_dist(scans=3))
        assert laser.sensor_state()["STAT"] == "sensor is working normally"
        laser.standby()
        laser.close()
    assert ranges.shape == (1081,)
    assert pairs.shape == (1081, 2)
    assert [remaining for _, _, remaining in taken] == [2, 1, 0]


def test_scans_are_sent_when_their_last_step_is_measured_and_stamped_at_their_first() -> None:
    with simulated_laser(SimulatedLaserSettings(clock_start_ms=2**24 - 250)) as (device, room):
        client = Client(device)
        client.ask(b"MD0000108001003")
        counters, arrivals = [], []
        for _ in range(3):
            counters.append(parse_time(parse_message(client.message()).lines[0]))
            arrivals.append(time.monotonic_ns())
        client.close()
    steps = np.diff(counters) % 2**24  # the counter wraps among them
    assert steps.tolist() == pytest.approx([100, 100], abs=1)
    for arrival_ns in arrivals:
        delay_ms = min(arrival_ns - sweep_ns for sweep_ns in room.sweeps if sweep_ns < arrival_ns - 50_000_000) / 1e6
        assert delay_ms > 75.0


def test_a_second_client_is_turned_away_until_the_first_has_gone() -> None:
    with simulated_laser(SimulatedLaserSettings()) as (device, _):
        first, second = Client(device), Client(device)
        assert first.ask(b"QT") == b"QT\n00P"
        assert second.socket.recv(1) == b""
        first.close()
        second.close()
        third = Client(device)
        assert third.ask(b"QT") == b"QT\n00P"
        third.close()


def test_a_client_that_leaves_ends_the_stream() -> None:
    with simulated_laser(SimulatedLaserSettings(model="UST-10LX")) as (device, _):
        first = Client(device)
        first.ask(b"MD0000108001000")
        first.message()
        first.close()
        second = Client(device)
        assert second.ask(b"%ST").split(b"\n")[2] == b"000@"
        second.close()


def test_two_reboot_commands_drop_the_link_and_start_the_clock_anew() -> None:
    settings = SimulatedLaserSettings(clock_start_ms=1_000_000, boot_s=0.05, reboot_disconnect_s=0.05)
    with simulated_laser(settings) as (device, _):
        client = Client(device)
        assert client.ask(b"RB") == b"RB\n01Q"
        assert client.ask(b"RB") == b"RB\n00P"
        assert client.socket.recv(1) == b""
        client.close()
        wait_for(lambda: device.is_listening)
        client = Client(device)
        values = parse_key_values(parse_message(client.ask(b"II")))
        client.close()
    assert int(values["TIME"], 16) < 2000


def test_an_address_that_is_taken_is_named() -> None:
    with simulated_laser(SimulatedLaserSettings()) as (device, _):
        other = LaserDevice(
            SimulatedLaserSettings(port=address_of(device)[1]), NoisyRoom().ranges_at, time.monotonic_ns
        )
        with pytest.raises(LinkError, match="choose another address"):
            other.start()
        other.close()


def test_faults_of_the_configuration_come_by_themselves() -> None:
    fault = LaserFault.model_validate({"kind": "silence", "start_s": 0.05, "duration_s": 0.2})
    with simulated_laser(SimulatedLaserSettings(faults=(fault,))) as (device, _):
        wait_for(lambda: device.has_faults)
        wait_for(lambda: not device.has_faults)


def test_a_closed_device_leaves_no_thread() -> None:
    with simulated_laser(SimulatedLaserSettings()):
        pass
    assert not [thread for thread in threading.enumerate() if thread.name == "simulated-laser"]
