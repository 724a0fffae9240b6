"""What runs once per feature or landmark borrows its arrays and counts no references."""

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
