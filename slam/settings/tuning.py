"""The numbers that the compiled step needs, as one flat value."""

from enum import IntEnum
from typing import NamedTuple

from slam.settings.sigma_points import UnscentedWeights


class Tuning(NamedTuple):
    """Settings of the filter in the form that compiled code takes; slam.settings says what each one means.

    Log likelihoods are natural logarithms; bounds on a match are logarithms of the likelihood over its own peak, that
    is minus half the squared Mahalanobis distance.
    """

    proposal: int
    strategy: int
    density: bool
    existence: bool
    exclusivity: bool
    range_gate: bool
    match_base: float
    match_per_metre: float
    match_floor: float
    match_fixed: float
    match_known: float
    create_distance: float
    log_unmatched: float
    log_odds_new: float
    log_odds_seen: float
    log_odds_missed: float
    log_odds_max: float
    log_odds_remove: float
    range_max_m: float
    range_margin_m: float
    missed_range_m: float
    missed_bearing_rad: float
    sight_margin_m: float
    sight_half_width_m: float
    cell_m: float
    joint_weights: UnscentedWeights
    single_weights: UnscentedWeights
    spread: float


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
