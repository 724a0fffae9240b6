"""The recorder on real trouble: a small disk that is full, read-only or gone while it runs, and SIGKILL."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from runtime.source_tree import ROOT

LIMIT_S = 0.5
LONGEST_PUT_US = 2000.0


def trial(*words: str | Path, isolated: bool = False) -> dict[str, Any]:
    command = [sys.executable, "-m", "tests.support.runtime.storage_trials", *map(str, words)]
    if isolated:
        command = ["unshare", "-rm", *command]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def need_mounts() -> None:
    may = (
        shutil.which("unshare")
        and not subprocess.run(
            ["unshare", "-rm", "mount", "-t", "tmpfs", "tmpfs", "/mnt"], capture_output=True, check=False
        ).returncode
    )
    if not may:
        pytest.skip("this machine does not let a test mount a small disk of its own (unshare -rm)")


def check_faults(tmp_path: Path, cycles: int) -> dict[str, Any]:
    need_mounts()
    trials = trial("faults", tmp_path, str(cycles), isolated=True)
    for fault, seen in trials.items():
        sys.stdout.write(f"{fault} {json.dumps(seen)}\n")
        assert seen["in_order"], fault
        assert seen["last"], fault
        assert seen["read"] + seen["told"] == seen["ticks"], (fault, seen)
        assert seen["troubles"]
    return trials


def test_recording_resumes_after_a_full_a_read_only_and_a_removed_disk(tmp_path: Path) -> None:
    check_faults(tmp_path, 1)


@pytest.mark.soak
def test_recording_resumes_ten_times_each(tmp_path: Path) -> None:
    assert max(seen["put_us_p99"] for seen in check_faults(tmp_path, 10).values()) < LONGEST_PUT_US


def test_a_killed_recorder_leaves_its_ticks_in_order(tmp_path: Path) -> None:
    assert trial("kills", tmp_path, "5")["kills"] == 5


@pytest.mark.soak
def test_two_hundred_kills_lose_less_than_half_a_second_each(tmp_path: Path) -> None:
    seen = trial("kills", tmp_path, "200")
    sys.stdout.write(json.dumps(seen) + "\n")
    assert seen["lost_s_max"] <= LIMIT_S, seen
    assert seen["segments"] > 1
