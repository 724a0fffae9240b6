"""What the export of an hour costs as users type it; `make bench ARGS="-n 0 -s -k of_an_hour"` prints it."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from runtime.settings.configuration import load_configuration
from runtime.source_tree import ROOT
from runtime.studies.soak.stepped_drive import stepped_drive
from tests.support.runtime.process_memory import held_mb

DRIVEN_S = 3600.0
MOST_S, MOST_MB = 60.0, 500.0
LOOK_S = 0.1


@pytest.mark.bench
@pytest.mark.timeout(7200)
def test_the_export_of_an_hour_fits_into_its_memory(tmp_path: Path) -> None:
    configuration = load_configuration(ROOT / "config" / "mock.toml")
    assert configuration.simulation is not None
    stepped_drive(configuration, configuration.simulation, DRIVEN_S, tmp_path / "run")
    for option, out in (("--ros2", "bag"), ("--csv", "csv"), ("--tum", "tum"), ("--geojson", "geojson")):
        words = ("export", str(tmp_path / "run"), option, str(tmp_path / out))
        began_s, most_mb = time.monotonic(), 0.0
        with subprocess.Popen([sys.executable, "-m", "runtime.cli", *words], stdout=subprocess.DEVNULL) as tree:
            while tree.poll() is None:
                most_mb = max(most_mb, held_mb(tree.pid))
                time.sleep(LOOK_S)
        took_s = time.monotonic() - began_s
        print(f"\n{option}: {took_s:.1f} s (must be {MOST_S:.0f}), {most_mb:.0f} MB (must be {MOST_MB:.0f})")  # noqa: T201
        assert tree.returncode == 0
        assert most_mb < MOST_MB
