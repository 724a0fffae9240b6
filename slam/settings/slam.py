"""Settings of the whole estimator. Geometry and noise belong to a data set; all else has one default for all."""

import math
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from slam.pose import Pose2
from slam.settings.front_end import FrontEndSettings
from slam.settings.joint import JointSettings
from slam.settings.odometry import OdometrySettings
from slam.settings.quality import QualitySettings
from slam.settings.sigma_points import UnscentedSettings, unscented_weights
from slam.settings.tuning import Proposal, Strategy, Tuning


class TechniqueSettings(BaseModel):
    """The six techniques of the paper, each with its switch; all off is its "normal estimation"."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    difference: bool = Field(default=True, description="keep only what an earlier scan saw as well (III-A-1)")
    sparse: bool = Field(default=True, description="minimum spacing of features (III-A-2)")
    density: bool = Field(
        default=True, description="threshold by distance to the neighbouring landmark (5); off: fixed gate"
    )
    existence: bool = Field(default=True, description="log-odds per landmark and removal (6)")
    exclusivity: bool = Field(default=True, description="one feature per landmark and scan (III-B-2)")
    range: bool = Field(default=True, description="likelihoods only for landmarks that can be in view (III-B-3)")


class MountSettings(BaseModel):
    """body_from_laser."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    x_m: float = Field(default=0.0, ge=-20, le=20, description="m ahead of the body's origin")
    y_m: float = Field(default=0.0, ge=-20, le=20, description="m left of it")
    yaw_rad: float = Field(default=0.0, ge=-math.pi, le=math.pi, description="rad, counter-clockwise")

    def as_pose(self) -> Pose2:
        """body_from_laser."""
        return Pose2(self.x_m, self.y_m, self.yaw_rad)


class ViewSettings(BaseModel):
    """Where landmarks can be seen at all, and where not seeing one means something."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    range_max_m: float = Field(default=30.0, gt=0, le=500, description="m; features farther away are not used")
    range_margin_m: float = Field(
        default=3.0, ge=0, le=50, description="m added where candidates are gathered: landmarks move a little"
    )
    missed_range_m: float = Field(
        default=25.0, ge=0, le=500, description="m up to which an unseen landmark counts as missed"
    )
    missed_bearing_rad: float = Field(
        default=math.radians(130.0), ge=0, le=math.pi, description="rad to either side; 5 deg inside the sensor's edge"
    )
    sight_margin_m: float = Field(
        default=0.5, ge=0, le=10, description="m behind a landmark that beams must pass to count as clear view"
    )
    sight_half_width_m: float = Field(
        default=0.3, ge=0, le=5, description="m to either side of a landmark that must be clear as well"
    )


class AssociationSettings(BaseModel):
    """Which feature is which landmark. Bounds are log-likelihoods relative to their peak: minus half the squared
    distance.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    strategy: Literal["sequential", "simultaneous", "known"] = Field(
        default="sequential",
        description="nearest first with the pose updated between, or the printed form, or by reported identity",
    )
    match_base: float = Field(default=-3.0, ge=-50, le=0, description="M_c of (5): squared distance 6, the 95 % gate")
    match_per_metre: float = Field(default=0.6, ge=0, le=10, description="K of (5), 1/m")
    match_floor: float = Field(
        default=-8.0, ge=-100, le=0, description="least M_th: without it a lonely landmark accepts anything"
    )
    match_fixed: float = Field(
        default=-4.605, ge=-100, le=0, description="bound without the density technique: the 99 % gate"
    )
    match_known: float = Field(
        default=-25.0, ge=-1000, le=0, description="bound for known identities; a sensor misreads a few"
    )
    create_distance: float = Field(
        default=50.0,
        ge=0,
        le=1e6,
        description="squared distance to every landmark below which a feature creates none (with density): it may be "
        "that landmark, or the thing's other edge; 16 leaves a fifth more landmarks among people",
    )
    log_unmatched: float = Field(
        default=-7.0,
        ge=-50,
        le=10,
        description="log-likelihood p0 of a feature that matches nothing: one per some hundred m rad in view",
    )


class ExistenceSettings(BaseModel):
    """Log-odds that a landmark is real (6)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    new: float = Field(default=0.6, ge=-10, le=20, description="log-odds of a landmark seen once")
    seen: float = Field(default=1.0, ge=0, le=20, description="added when it is seen")
    missed: float = Field(default=0.7, ge=0, le=20, description="taken away when it should have been seen and was not")
    highest: float = Field(
        default=6.0, ge=0, le=100, description="bound, so that a thing that went away is forgotten in time"
    )
    remove: float = Field(default=-1.0, ge=-50, le=10, description="a landmark below this is removed")


class SlamSettings(BaseModel):
    """Everything the estimator is told."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    particles: int = Field(default=100, ge=1, le=100_000, description="number of particles; 30 to 100 suffice")
    proposal: Literal["motion", "ekf", "unscented"] = Field(
        default="unscented", description="where poses are sampled from"
    )
    resample_share: float = Field(
        default=0.3, ge=0, le=1, description="resample when the effective number falls below this share"
    )
    cell_m: float = Field(default=15.0, gt=0.5, le=200, description="m; edge of the cells that landmarks are kept in")
    map_every: int = Field(default=10, ge=1, le=100_000, description="the map goes with every so many-th estimate")
    mount: MountSettings = Field(default_factory=MountSettings)
    techniques: TechniqueSettings = Field(default_factory=TechniqueSettings)
    odometry: OdometrySettings = Field(default_factory=OdometrySettings)
    front_end: FrontEndSettings = Field(default_factory=FrontEndSettings)
    view: ViewSettings = Field(default_factory=ViewSettings)
    association: AssociationSettings = Field(default_factory=AssociationSettings)
    existence: ExistenceSettings = Field(default_factory=ExistenceSettings)
    unscented: UnscentedSettings = Field(default_factory=UnscentedSettings)
    joint: JointSettings = Field(default_factory=JointSettings)
    quality: QualitySettings = Field(default_factory=QualitySettings)

    def tuning(self) -> Tuning:
        """The part that the compiled step needs. Exclusivity off means the printed simultaneous form."""
        association, existence, view = self.association, self.existence, self.view
        strategy = Strategy[association.strategy.upper()]
        if strategy is Strategy.SEQUENTIAL and not self.techniques.exclusivity:
            strategy = Strategy.SIMULTANEOUS
        return Tuning(
            proposal=int(Proposal[self.proposal.upper()]),
            strategy=int(strategy),
            density=self.techniques.density,
            existence=self.techniques.existence,
            exclusivity=self.techniques.exclusivity,
            range_gate=self.techniques.range,
            match_base=association.match_base,
            match_per_metre=association.match_per_metre,
            match_floor=association.match_floor,
            match_fixed=association.match_fixed,
            match_known=association.match_known,
            create_distance=association.create_distance,
            log_unmatched=association.log_unmatched,
            log_odds_new=existence.new,
            log_odds_seen=existence.seen,
            log_odds_missed=existence.missed,
            log_odds_max=existence.highest,
            log_odds_remove=existence.remove,
            range_max_m=view.range_max_m,
            range_margin_m=view.range_margin_m,
            missed_range_m=view.missed_range_m,
            missed_bearing_rad=view.missed_bearing_rad,
            sight_margin_m=view.sight_margin_m,
            sight_half_width_m=view.sight_half_width_m,
            cell_m=self.cell_m,
            joint_weights=unscented_weights(5, self.unscented),
            single_weights=unscented_weights(2, self.unscented),
            spread=self.unscented.beta - self.unscented.alpha**2,
        )
