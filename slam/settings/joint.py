"""Settings of the joint Gaussian beside the particles."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class JointSettings(BaseModel):
    """How the published pose, its covariance and the published map come about.

    Names that end in _square are squared Mahalanobis distances. View and existence are the estimator's own, so that
    particles and joint Gaussian mean the same by a landmark.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    association: Literal["own", "particles"] = Field(
        "own", description="who decides which feature is which landmark; the best particle's slips would be inherited"
    )
    creation: Literal["any", "licensed"] = Field(
        "licensed",
        description="which features may start a landmark; 'any' let walking people drag the pose: 47 mm against 7 mm "
        "in one simulated drive of a minute, and the same in two others",
    )
    jacobians: Literal["invariant", "first_estimates", "current"] = Field(
        "invariant", description="where derivatives are taken; 'current' alone grows overconfident in heading"
    )
    match_base_square: float = Field(
        6.0, ge=0, le=1000, description="gate of a landmark in a crowd: 95 % of true matches"
    )
    match_per_metre_square: float = Field(
        1.2, ge=0, le=1000, description="1/m; the gate grows with the distance to the nearest other landmark, (5)"
    )
    match_widest_square: float = Field(13.816, ge=0, le=1000, description="the widest gate: 99.9 % of true matches")
    match_known_square: float = Field(
        50.0, ge=0, le=1e6, description="gate where the sensor reports identities; it misreads a few"
    )
    slip_square: float = Field(
        100.0,
        ge=0,
        le=1e6,
        description="gate within which an old landmark is looked for when most are not where the wheels say",
    )
    create_square: float = Field(
        25.0, ge=0, le=1e6, description="a feature nearer than this to a landmark creates none: it may be that landmark"
    )
    confirmed_log_odds: float = Field(
        3.0, ge=-50, le=100, description="a landmark that leaves the view below this is forgotten: a chance point"
    )
    settled_scans: int = Field(
        30, ge=1, le=100_000, description="scans after which a landmark is an old one: a walker has gone by then"
    )
    landmarks_in_state: int = Field(
        96,
        ge=2,
        le=4096,
        description="landmarks in the joint state, and half as many far ones at least, however many are near: they "
        "hold the map together when a loop closes; a step costs the square",
    )
    distance_scale_sigma: float = Field(
        0.02, ge=0, le=1, description="standard deviation of a constant relative error of every distance driven"
    )
    turn_scale_sigma: float = Field(
        0.02, ge=0, le=1, description="standard deviation of a constant relative error of every turn"
    )
    curvature_sigma_radpm: float = Field(
        0.001, ge=0, le=1, description="rad/m; standard deviation of a constant pull to one side"
    )
