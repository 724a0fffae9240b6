"""A configuration is read by commands that compute nothing: what only computing needs is not loaded for it."""

import subprocess
import sys

import can
import pytest

from drivers.settings.encoders import EncoderSettings
from drivers.wheels.layouts.choose import wheel_decoder
from runtime.setup.validation import COMMON_INTERFACES
from runtime.source_tree import ROOT

HEAVY = ("numba", "llvmlite", "scipy", "slam.estimator", "rerun", "matplotlib", "pyarrow", "zenoh")
UNUSED = ("can", "cantools", "asyncio", "rich", "runtime.live.run", "jinja2", "bokeh")
"""What neither the help nor a check of a file needs: cantools, python-can and asyncio took 0.17 s of 0.54 s of CPU."""
CHECK = (
    "import sys; from runtime.cli.__main__ import app; "
    "sys.argv[1:] = ['check', '--config', 'config/mock.toml']; app(standalone_mode=False)"
)
HELP = CHECK.replace("['check', '--config', 'config/mock.toml']", "['--help']")


def loaded_by(program: str, names: tuple[str, ...]) -> set[str]:
    told = f"{program}; print('LOADED', *(name for name in {names} if name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", told], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split()[1:])


@pytest.mark.parametrize("program", ["import sys, runtime.settings.configuration", CHECK])
def test_reading_a_configuration_loads_nothing_that_computes_or_draws(program: str) -> None:
    assert loaded_by(program, HEAVY) == set()


@pytest.mark.parametrize(("program", "also"), [(CHECK, ()), (HELP, ("numpy", "pydantic", "tomllib"))])
def test_help_and_a_check_of_a_file_load_only_what_they_need(program: str, also: tuple[str, ...]) -> None:
    assert loaded_by(program, (*HEAVY, *UNUSED, *also)) == set()


def test_the_state_of_a_rover_loads_only_what_it_needs() -> None:
    also = ("rosbags", "mcap", "numpy", "runtime.settings.configuration")
    names = tuple(name for name in (*HEAVY, *UNUSED, *also) if name != "zenoh")
    assert loaded_by("import sys, runtime.publish.status", names) == set()


def test_what_is_taken_for_granted_instead_is_so() -> None:
    assert set(COMMON_INTERFACES) <= set(can.VALID_INTERFACES)
    assert wheel_decoder(EncoderSettings())
