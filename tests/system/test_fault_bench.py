"""Rows of the fault table that only a kernel can make, a hundred times each."""

import pytest

from tests.system.bench.can_bench import BenchUnavailableError, run_bench
from tests.system.bench.fault_guest import TIMES
from tests.system.test_can_bench import FOLDER, RECOVERED_S, WRONG_MM

LIMIT_S = 600.0
pytestmark = [pytest.mark.system, pytest.mark.timeout(LIMIT_S + 60.0)]


@pytest.mark.parametrize("name", ["down", "deleted", "clock", "late", "overflow"])
def test_each_is_counted_over_within_a_second_and_moves_nothing_a_hundred_times(name: str) -> None:
    try:
        results = run_bench(FOLDER, "fault_guest", LIMIT_S, task=name)
    except BenchUnavailableError as reason:
        pytest.skip(f"no bench: {reason}")
    result = results[f"repeated {name}"]
    assert result["trials"] == TIMES, result
    assert result["uncounted"] == 0, result
    assert result["recovery_s"] < RECOVERED_S, result
    assert result["wrong_mm"] < WRONG_MM, result
