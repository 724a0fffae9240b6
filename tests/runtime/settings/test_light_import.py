"""A configuration is read by commands that compute nothing: what only computing needs is not loaded for it."""

import subprocess
import sys

import pytest

from runtime.source_tree import ROOT

HEAVY = ("numba", "llvmlite", "scipy", "slam.estimator", "rerun", "matplotlib", "pyarrow", "zenoh")
CHECK = (
    "import sys; from runtime.cli.__main__ import app; "
    "sys.argv[1:] = ['check', '--config', 'config/mock.toml']; app(standalone_mode=False)"
)


@pytest.mark.parametrize("program", ["import sys, runtime.settings.configuration", CHECK])
def test_reading_a_configuration_loads_nothing_that_computes_or_draws(program: str) -> None:
    loaded = f"{program}; print('LOADED', *(name for name in {HEAVY} if name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", loaded], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1].split()[1:] == []
