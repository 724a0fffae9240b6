"""What runs once per feature or landmark borrows its arrays and counts no references."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError

import slam.joint.association
import slam.particles.association
import slam.particles.gates
import slam.particles.gather
import slam.particles.landmark_filter
import slam.particles.pages
import slam.particles.proposals
import slam.particles.step
from slam.compiled import leaf

ROOT = Path(__file__).parents[2]
INNER = (
    slam.particles.association.best_landmark,
    slam.particles.gates.all_outside,
    slam.particles.gates.moments_of,
    slam.particles.proposals.unscented_moments,
    slam.particles.proposals.linearised_moments,
    slam.particles.proposals.fold_in,
    slam.particles.landmark_filter.update_landmark,
    slam.particles.step.update_matches,
    slam.particles.step.lower_missed,
    slam.particles.gather.write_back,
    slam.particles.pages.writable,
    slam.joint.association.distance_to,
)


@pytest.mark.parametrize("function", INNER, ids=lambda function: function.__name__)
def test_an_inner_kernel_is_a_leaf(function: Dispatcher) -> None:
    assert function.targetoptions["_nrt"] is False


def test_a_leaf_that_allocates_is_refused_when_it_is_compiled() -> None:
    @leaf
    def allocating(count: int) -> float:
        return float(np.ones(count).sum())

    with pytest.raises(NumbaError):
        allocating(3)


@pytest.mark.parametrize("room", [0, 100, 3000])
def test_a_disk_that_is_full_keeps_no_kernel_and_stops_none(tmp_path: Path, room: int) -> None:
    """The machine code is made once more at the next start: a run on a card that is full ended in a traceback."""
    code = f"""
import resource
from slam.compiled import kernel
@kernel
def doubled(value):
    return 2.0 * value
resource.setrlimit(resource.RLIMIT_FSIZE, ({room}, {room}))
print(doubled(1.5))
"""
    (tmp_path / "kernels.py").write_text(code)  # numba keeps nothing of what stands in no file
    found = subprocess.run(
        [sys.executable, str(tmp_path / "kernels.py")],
        env={**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.stdout.strip() == "3.0", found.stderr
