"""The numbers that the compiled step needs, as one flat value."""

from enum import IntEnum
from typing import NamedTuple

from slam.arithmetic.elementary import squared
from slam.settings.sigma_points import ALPHA, BETA, UnscentedWeights, unscented_weights

LASTING = 0.05, 0.01  # m and rad, sigmas of what a look at a thing has in common with the next one (decision 48)


class Tuning(NamedTuple):
    """Numbers of the filter in the form that compiled code takes.

    Those without a value here are settings, which slam.settings explains; the others are constants with their origin.
    Names that end in _square are squared Mahalanobis distances, log-likelihoods and log-odds are natural logarithms.
    """

    proposal: int
    strategy: int
    density: bool
    existence: bool
    exclusivity: bool
    range_gate: bool
    match_square: float
    match_per_metre_square: float
    match_known_square: float
    range_max_m: float
    range_margin_m: float
    lasting: tuple[float, float] = LASTING
    match_widest_square: float = 16.0  # of the particles: without it a lonely landmark accepts anything
    match_fixed_square: float = 9.21  # without the density technique: 99 % of true matches
    # nearer to a landmark none is created: it may be that landmark, or the thing's other edge; 16 leaves a fifth more
    # landmarks among people. With density only
    create_square: float = 50.0
    log_unmatched: float = -7.0  # p0 of a feature that matches nothing: one per some hundred m rad in view
    log_odds_new: float = 0.6  # of a landmark seen once (6)
    log_odds_seen: float = 1.0  # added when it is seen
    log_odds_missed: float = 0.7  # taken away when it should have been seen and was not
    log_odds_max: float = 6.0  # so that a thing that went away is forgotten in time
    log_odds_remove: float = -1.0  # a landmark below this is removed
    sight_margin_m: float = 0.5  # behind a landmark that beams must pass to count as clear view
    sight_half_width_m: float = 0.3  # to either side of a landmark that must be clear as well
    cell_m: float = 15.0  # edge of the cells that landmarks are kept in
    joint_weights: UnscentedWeights = unscented_weights(5)
    single_weights: UnscentedWeights = unscented_weights(2)
    spread: float = BETA - squared(ALPHA)


class Strategy(IntEnum):
    """How features find their landmarks."""

    SEQUENTIAL = 0
    SIMULTANEOUS = 1
    KNOWN = 2


class Proposal(IntEnum):
    """Where the new pose is sampled from."""

    MOTION = 0
    EKF = 1
    UNSCENTED = 2
