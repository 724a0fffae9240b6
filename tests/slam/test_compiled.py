"""What runs once per feature or landmark borrows its arrays and counts no references."""

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError

import slam.association
import slam.gathering
import slam.joint_association
import slam.kernels
import slam.landmark_filter
import slam.match_bounds
import slam.pages
import slam.proposals
from slam.compiled import leaf

INNER = (
    slam.association.best_landmark,
    slam.match_bounds.all_outside,
    slam.match_bounds.moments_of,
    slam.proposals.unscented_moments,
    slam.proposals.linearised_moments,
    slam.proposals.fold_in,
    slam.landmark_filter.update_landmark,
    slam.kernels.update_matches,
    slam.kernels.lower_missed,
    slam.gathering.write_back,
    slam.pages.writable,
    slam.joint_association.distance_to,
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
