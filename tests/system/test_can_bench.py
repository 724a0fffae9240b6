"""The wheels on a real CAN stack: vcan and kernel slcan in a User-Mode Linux guest."""

import os
from pathlib import Path
from typing import Any

import pytest

from tests.system.bench.can_bench import BenchUnavailableError, run_bench

pytestmark = pytest.mark.system
FOLDER = Path(os.environ.get("INFANT_BENCH", Path.home() / ".cache" / "infant-bench"))
RECOVERED_S = 1.0
WRONG_MM = 10.0


@pytest.fixture(scope="module")
def results() -> dict[str, dict[str, Any]]:
    try:
        return run_bench(FOLDER)
    except BenchUnavailableError as reason:
        pytest.skip(f"no bench: {reason}")


def test_the_guest_ran_to_its_end(results: dict[str, dict[str, Any]]) -> None:
    assert results["exit"]["code"] == 0, results


def test_an_absent_and_a_downed_interface_are_named_with_their_commands(
    results: dict[str, dict[str, Any]],
) -> None:
    assert "sudo ip link add vcan0 type vcan" in results["absent"]["reason"]
    assert results["absent"]["attempts"] >= 2
    assert "the interface is down; sudo ip link set vcan0 up" in results["down"]["reason"]


@pytest.mark.parametrize(
    ("name", "counter"),
    [
        ("plain", "bus.sessions"),
        ("interface_down", "bus.read"),
        ("interface_deleted", "bus.read"),
        ("bus_off", "bus.bus_off"),
        ("passive", "bus.passive"),
        ("burst", "bus.sessions"),
        ("clock", "bus.clock_jump"),
        ("slcan", "bus.sessions"),
    ],
)
def test_trouble_is_counted_over_in_a_second_and_moves_nothing(
    results: dict[str, dict[str, Any]], name: str, counter: str
) -> None:
    result = results[name]
    assert result["counters"][counter] >= 1
    if name not in ("plain", "slcan"):
        assert 0.0 <= result["recovery_s"] < RECOVERED_S
    assert result["wrong_mm"] < WRONG_MM


def test_a_downed_interface_fails_the_sensor_while_it_lasts(results: dict[str, dict[str, Any]]) -> None:
    for name in ("interface_down", "interface_deleted"):
        assert results[name]["during"] == "failed"
