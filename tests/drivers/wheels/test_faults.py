"""The fault table of the wheels: each fault a hundred times, in virtual time."""

from itertools import pairwise
from typing import Any

import pytest

from tests.support.drivers.virtual_drive import VirtualDrive

TIMES = 100
NO_WRONG_MOTION_M = 0.01
FAULTS = [
    # fault, counter that must tell, further values
    ("loss", "left.lost", {"probability": 0.5}),
    ("duplicate", "left.duplicate", {"probability": 0.5}),
    ("reorder", "left.out_of_order", {"probability": 0.5}),
    ("bad_crc", "left.crc", {"probability": 0.5}),
    ("bad_crc", "left.crc", {}),
    ("bad_length", "left.length", {}),
    ("remote", "left.remote", {}),
    ("fd", "left.fd", {}),
    ("extended", "left.extended", {}),
    ("alive_frozen", "left.alive_frozen", {}),
    ("second_sender", "left.two_senders", {"value": 9}),
    ("second_sender", "left.two_senders", {"value": 1}),
    ("second_sender", "left.two_senders", {"value": 1, "magnitude": 40}),
    ("silence", "left.lost", {}),
    ("silence_all", "lost_together", {"wheel": "both"}),
    ("status", "left.status", {"value": 2}),
    ("status", "left.status", {"value": 15}),
    ("status", "left.status", {"value": 9}),
    ("stuck", "left.stuck", {}),
    ("jump", "left.jump", {"magnitude": 5000}),
    ("jump", "left.jump", {"magnitude": -100000}),
    ("jump", "left.gap", {"magnitude": 150}),  # possible as motion; at odds with the speed,
    ("power_cycle", "left.power_cycle", {}),
    ("wrong_counts_per_rev", "left.configuration", {"value": 1024, "seconds": 1.1}),
    ("bus_off", "bus.bus_off", {"wheel": "both"}),
    ("error_passive", "bus.passive", {"wheel": "both", "seconds": 0.1}),
    ("error_warning", "bus.warning", {"wheel": "both", "seconds": 0.1}),
    ("error_flood", "bus.bus_error", {"wheel": "both"}),
]


def counted(drive: VirtualDrive, key: str) -> int:
    wheel, _, name = key.rpartition(".")
    counters = {
        "left": drive.pair.left.counters,
        "right": drive.pair.right.counters,
        "bus": drive.pair.events.counters,
    }
    return counters.get(wheel, drive.pair.events.counters)[name]


@pytest.mark.parametrize(("fault", "counter", "values"), FAULTS)
def test_each_fault_is_counted_and_over_within_a_second_and_moves_nothing(
    fault: str, counter: str, values: dict[str, Any]
) -> None:
    values = dict(values)
    seconds = values.pop("seconds", 0.0)
    for seed in range(TIMES):
        drive = VirtualDrive(seed)
        drive.run(0.2 + 0.02 * (seed % 17))
        drive.inject(fault, values)
        drive.run(seconds or 0.3 + 0.01 * (seed % 20))
        drive.clear()
        recovered = drive.run_until_valid(1.0)
        drive.run(0.06)
        assert counted(drive, counter) > 0, f"{fault}, seed {seed}: {counter} not counted: {drive.pair.left.counters}"
        assert drive.pair.trouble(drive.now_ns) == "", f"{fault}, seed {seed}"
        assert recovered, f"{fault}, seed {seed}: no valid sample within 1 s"
        stamps = [s.stamp_ns for s in drive.samples]
        assert all(a < b for a, b in pairwise(stamps))
        wrong_m = drive.wrong_motion_m()
        assert wrong_m <= NO_WRONG_MOTION_M, f"{fault}, seed {seed}: {wrong_m * 1000:.1f} mm of wrong motion"
