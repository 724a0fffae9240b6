"""Fixtures of the whole suite."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from xdist.scheduler import LoadScopeScheduling

from runtime.source_tree import SHARED_DATA
from tests.support.examples import USUAL

# A property test draws the same inputs each time; neither a slow machine nor a kernel that compiles on its first call
# fails it. `make fuzz` looks for new counterexamples; hypothesis keeps those in .hypothesis and tries them first.
UNHURRIED = settings(deadline=None, print_blob=True, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("default", UNHURRIED, max_examples=USUAL, derandomize=True, database=None)
settings.register_profile("fuzz", UNHURRIED, max_examples=20 * USUAL, derandomize=False)
settings.load_profile("default")

# Tests of threads, sockets, processes and the clock run in one process one after the other, beside all others.
REAL_TIME = tuple(
    f"tests/{folder}/"
    for folder in ("drivers", "runtime/cli", "runtime/live", "runtime/publish", "runtime/service", "runtime/setup")
)

RECORDED = Path(os.environ.get("INFANT_DATA", SHARED_DATA))


def work_unit(nodeid: str) -> str:
    """Whole files, so that their fixtures are made once; those of real time as one."""
    return "real time" if nodeid.startswith(REAL_TIME) else nodeid.partition("::")[0]


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> LoadScopeScheduling:
    """Called by xdist where tests run in several processes (`make test`); the largest unit is the first."""
    scheduler = LoadScopeScheduling(config, log)
    scheduler._split_scope = work_unit
    return scheduler


@pytest.fixture(scope="session")
def recorded_data() -> Callable[[str], Path]:
    """Path of a real recording by name; skips with the reason where the recordings are absent."""

    def folder(name: str) -> Path:
        path = (RECORDED / name).resolve()
        if not path.exists():
            pytest.skip(f"recording {name} is not in {RECORDED}; set INFANT_DATA to the folder that has it")
        return path

    return folder


@pytest.fixture(scope="module")
def patient_drawing() -> Iterator[None]:
    """The drawing process is given all the time that it needs: it has the lowest claim on a machine that is busy."""
    with pytest.MonkeyPatch.context() as patched:
        for limit in ("DRAW_S", "STALLED_S", "RENEW_S"):
            patched.setattr(f"runtime.live.drawing_process.{limit}", 600.0)
        yield
