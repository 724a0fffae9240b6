"""What the review of 26 minutes costs as users type it; `make bench ARGS="-n 0 -s -k long_run"` prints it."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from runtime.settings.configuration import load_configuration
from runtime.source_tree import ROOT
from runtime.studies.soak.stepped_drive import stepped_drive
from tests.support.runtime.process_memory import held_mb

DRIVEN_S = 26 * 60.0
MOST_MB = 300.0
LOOK_S = 0.1


@pytest.mark.bench
@pytest.mark.timeout(3600)
def test_the_review_of_a_long_run_fits_into_its_memory(tmp_path: Path) -> None:
    configuration = load_configuration(ROOT / "config" / "mock.toml")
    assert configuration.simulation is not None
    stepped_drive(configuration, configuration.simulation, DRIVEN_S, tmp_path / "run")
    began_s, before = time.monotonic(), os.times()
    with subprocess.Popen(
        [sys.executable, "-m", "runtime.cli", "review", str(tmp_path / "run"), "--json"], stdout=subprocess.DEVNULL
    ) as tree:
        most_mb = 0.0
        while tree.poll() is None:
            most_mb = max(most_mb, held_mb(tree.pid))
            time.sleep(LOOK_S)
    wall_s, after = time.monotonic() - began_s, os.times()
    used_s = after.children_user + after.children_system - before.children_user - before.children_system
    load = os.getloadavg()[0]
    print(  # noqa: T201
        f"\nreview of {DRIVEN_S / 60:.0f} min: {wall_s:.1f} s (must be 15 on a quiet machine), {used_s:.1f} s of CPU, "
        f"{most_mb:.0f} MB in all its processes (must be {MOST_MB:.0f}), load {load:.1f}"
    )
    assert tree.returncode == 0
    assert most_mb < MOST_MB
