"""A room and a look around in it, so that every kernel is compiled before the first is needed."""

import numpy as np

from slam.arithmetic.functions import cosines_sines
from slam.maps.views import BEAMS, Views, kept_points
from slam.scan_search.ground import ground_of
from slam.scan_search.laying import Laying

AHEAD_M, LEFT_M = 4.0, 3.0


def warm_up_scan_search() -> None:
    """Make the plan of a room and find the rover in it."""
    angles = np.linspace(-np.pi, np.pi, BEAMS, endpoint=False)
    rays = np.column_stack(cosines_sines(angles))
    walls = rays / np.maximum(np.abs(rays[:, :1]) / AHEAD_M, np.abs(rays[:, 1:]) / LEFT_M)
    laying = Laying(ground_of(Views(np.zeros((1, 3)), kept_points(walls)[None])), walls)
    while laying.advance(1_000_000) is None:
        pass
