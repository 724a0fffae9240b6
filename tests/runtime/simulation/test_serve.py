"""`infant sim` as a desk: any configuration's rover, faults of its world, and a record of what was sent."""

import io
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO, cast

import pytest

from drivers.settings.simulated_world import KidnapSettings
from runtime.api.simulated import SimulatedRover
from runtime.errors import RunExistsError, UsageError
from runtime.importers.data_set import import_data_set
from runtime.importers.wire_captures import load_candump
from runtime.settings.configuration import load_configuration
from runtime.simulation.serve import described, serve_laser, serve_rover
from runtime.simulation.typed_faults import obey
from tests.support.drivers.waiting import wait_until

ODRIVE = Path("examples/ust_odrive")


def test_a_rover_without_a_simulation_is_simulated_as_its_file_says_and_what_it_sends_is_kept(tmp_path: Path) -> None:
    stop, stream, folder = threading.Event(), io.StringIO(), tmp_path / "sent"
    words = {"simulation.laser.model": "UST-20LX"}
    desk = threading.Thread(target=serve_rover, args=(ODRIVE, words, stop, stream, None, folder))
    desk.start()
    candump = folder / "wheels.candump"
    try:
        assert wait_until(lambda: candump.exists() and candump.stat().st_size > 4096)
    finally:
        stop.set()
        desk.join()
    assert "infant setup --laser tcp://127.0.0.1:" in stream.getvalue()
    assert (
        " --wheel-radius 0.0825 --tread 0.42 --counts-per-rev 4096 --laser-ahead 0.25 --reverse right\n"
        in stream.getvalue()
    )
    encoders = load_configuration(ODRIVE).encoders
    assert encoders is not None
    assert len(load_candump(candump, encoders).arrays["odom_t"]) > 20
    assert import_data_set(folder, tmp_path / "run", ODRIVE)["wheel_samples"] > 20
    with pytest.raises(RunExistsError, match="give another name"):
        serve_rover(ODRIVE, words, stop, stream, None, folder)
    with pytest.raises(UsageError, match="model = 'UST-99'"):
        serve_rover(ODRIVE, {"simulation.laser.model": "UST-99"}, stop, stream)


def test_a_typed_kidnapping_moves_the_rover_and_a_fault_without_its_signal_is_refused() -> None:
    with SimulatedRover(load_configuration("mock")) as rover:
        rover.drive()
        devices = rover._rover.devices
        before = rover._rover.world.map_from_body(0)
        obey("world kidnap x_m=3 y_m=0 turn_deg=0", {"world": devices["world"]})
        moved = rover._rover.world.map_from_body(60_000_000_000)[0] - rover._rover.world.map_from_body(0)[0]
        assert before == (0.0, 0.0, 0.0)
        assert moved != 0.0
        assert KidnapSettings().kind in obey("help", devices)


def test_a_described_rover_can_be_put_into_another_place_and_keeps_its_geometry() -> None:
    path = Path("examples/ust_odrive")
    at_home, _ = described(path, {})
    moved, _ = described(path, {"simulation.world.place": "corridor", "simulation.laser.model": "UST-20LX"})
    assert (at_home.world.place, moved.world.place, moved.laser.model) == ("park", "corridor", "UST-20LX")
    assert moved.world.laser == at_home.world.laser
    assert moved.wheels == at_home.wheels
    with pytest.raises(
        UsageError, match="place = 'moon': expected 'park', 'building', 'corridor', 'orchard' or 'empty'"
    ):
        described(path, {"simulation.world.place": "moon"})
    simulated, _ = described(Path("mock"), {"simulation.world.place": "orchard"})
    assert simulated.world.place == "orchard"


def test_the_devices_go_on_and_obey_when_nobody_reads_what_they_say() -> None:
    class Gone(io.StringIO):
        def write(self, text: str) -> int:
            raise BrokenPipeError(32, "Broken pipe")

    stop = threading.Event()

    def typed() -> Iterator[str]:
        yield "help\n"
        yield "laser silence duration_s=1\n"
        stop.set()  # asked for a third line, so both were obeyed

    serve_laser(None, {}, stop, Gone(), cast("TextIO", typed()))
    assert stop.is_set()
