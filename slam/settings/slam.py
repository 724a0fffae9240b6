"""[slam]: the whole estimator. Geometry and noise belong to a vehicle or a data set; all else has one default."""

import math
from typing import Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from drivers.measurements import Scan, ScanLike
from slam.pose import Pose2
from slam.settings.front_end import FrontEndSettings
from slam.settings.joint import JointSettings
from slam.settings.odometry import OdometrySettings
from slam.settings.quality import QualitySettings
from slam.settings.tuning import LASTING, Proposal, Strategy, Tuning

OFF_TO_COMPARE = "Turn it off only to compare: --without"
Seen = TypeVar("Seen", Scan, ScanLike)


class TechniqueSettings(BaseModel):
    """The six techniques of the paper, each with its switch.

    With all of them off it is the paper's "normal estimation". For studies.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    difference: bool = Field(
        default=True, description=f"Keep only what an earlier scan saw as well (III-A-1). {OFF_TO_COMPARE} difference"
    )
    sparse: bool = Field(
        default=True, description=f"Keep features at least 0.10 m apart (III-A-2). {OFF_TO_COMPARE} sparse"
    )
    density: bool = Field(
        default=True,
        description="Match threshold that depends on the distance to the neighbouring landmark (5); a fixed gate "
        f"if off. {OFF_TO_COMPARE} density",
    )
    existence: bool = Field(
        default=True,
        description=f"Log-odds of existence for each landmark, and removal (6). {OFF_TO_COMPARE} existence",
    )
    exclusivity: bool = Field(
        default=True, description=f"At most one feature per landmark and scan (III-B-2). {OFF_TO_COMPARE} exclusivity"
    )
    range: bool = Field(
        default=True,
        description=f"Likelihoods only for landmarks that can be in view (III-B-3). {OFF_TO_COMPARE} range",
    )


class MountSettings(BaseModel):
    """Where the laser is mounted on the vehicle: body_from_laser.

    Measure it, or drive some loops and let `infant calibrate` find it.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    x_m: float = Field(
        default=0.0,
        ge=-20,
        le=20,
        description="Distance of the laser ahead of the middle of the wheels' axle. Measure it with a ruler, or "
        "let `infant calibrate` find it",
    )
    y_m: float = Field(
        default=0.0,
        ge=-20,
        le=20,
        description="Distance of the laser to the left of the middle. Measure it with a ruler, or let `infant "
        "calibrate` find it",
    )
    yaw_rad: float = Field(
        default=0.0,
        ge=-math.pi,
        le=math.pi,
        description="Angle by which the laser is turned to the left; pi for a laser that looks backwards. `infant "
        "calibrate` finds it",
    )

    upside_down: bool = Field(
        default=False,
        description="Whether the laser hangs upside down, which swaps left and right in its scans. `infant "
        "calibrate` finds it, and `infant review` reports a run that looks mirrored",
    )

    def as_pose(self) -> Pose2:
        """body_from_laser of the laser as if it stood upright."""
        return Pose2(self.x_m, self.y_m, self.yaw_rad)

    def upright(self, scan: Seen) -> Seen:
        """What a laser that stands upright would have seen."""
        return scan.mirrored() if self.upside_down else scan


class ViewSettings(BaseModel):
    """Where landmarks can be seen at all."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    range_max_m: float = Field(
        default=30.0,
        ge=0.5,
        le=500,
        description="Features farther away are ignored. Take the range of the sensor from its data sheet",
    )
    range_margin_m: float = Field(
        default=3.0,
        ge=0,
        le=50,
        description="Margin added when candidate landmarks are gathered, because landmarks move a little. Take "
        "about a tenth of range_max_m, 1 indoors",
    )


class AssociationSettings(BaseModel):
    """Which feature belongs to which landmark."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    strategy: Literal["sequential", "simultaneous", "known"] = Field(
        default="sequential",
        description="sequential: nearest first, updating the pose in between; simultaneous: as printed in the "
        "paper; known: by reported identity. Use known only if the sensor identifies its landmarks",
    )


class GateSettings(BaseModel):
    """Gates of association for particles and joint Gaussian: squared Mahalanobis distances of range and bearing
    (chi square with two degrees of freedom).
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    match: float = Field(
        default=6.0,
        ge=0,
        le=1000,
        description="Widest distance of a match in a crowd, -2 M_c of (5); 6 keeps 95 % of true matches. Raise it "
        "if true matches are refused because the noise is not Gaussian",
    )
    match_per_metre: float = Field(
        default=1.2,
        ge=0,
        le=1000,
        description="Growth of that distance with the distance to the nearest other landmark, 2 K of (5). Lower it "
        "where people who walk by are matched to isolated landmarks",
    )
    match_known: float = Field(
        default=50.0,
        ge=0,
        le=1e6,
        description="Widest distance of a match when the sensor reports identities (strategy known). Raise it for "
        "a sensor that never misreads one",
    )


class SlamSettings(BaseModel):
    """All settings of the estimator."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    particles: int = Field(
        default=100,
        ge=1,
        le=10_000,
        description="Number of particles; 30 to 100 are enough. Lower it if `infant bench` shows steps close to "
        "the beat",
    )
    proposal: Literal["motion", "ekf", "unscented"] = Field(
        default="unscented",
        description="Distribution from which poses are sampled; the paper's is unscented. Change it only to compare",
    )
    resample_share: float = Field(
        default=0.3,
        ge=0,
        le=1,
        description="resample when the effective number falls below this share of the particles; 1: in every scan",
    )
    mount: MountSettings = Field(default_factory=MountSettings)
    techniques: TechniqueSettings = Field(default_factory=TechniqueSettings)
    odometry: OdometrySettings = Field(default_factory=OdometrySettings)
    front_end: FrontEndSettings = Field(default_factory=FrontEndSettings)
    view: ViewSettings = Field(default_factory=ViewSettings)
    association: AssociationSettings = Field(default_factory=AssociationSettings)
    gates: GateSettings = Field(default_factory=GateSettings)
    joint: JointSettings = Field(default_factory=JointSettings)
    quality: QualitySettings = Field(default_factory=QualitySettings)

    def tuning(self) -> Tuning:
        """The part that the compiled step needs. Exclusivity off means the printed simultaneous form."""
        gates, reports = self.gates, self.front_end.kind == "given"
        strategy = Strategy[self.association.strategy.upper()]
        if strategy is Strategy.SEQUENTIAL and not self.techniques.exclusivity:
            strategy = Strategy.SIMULTANEOUS
        return Tuning(
            proposal=int(Proposal[self.proposal.upper()]),
            strategy=int(strategy),
            density=self.techniques.density,
            existence=self.techniques.existence,
            exclusivity=self.techniques.exclusivity,
            range_gate=self.techniques.range,
            match_square=gates.match,
            match_per_metre_square=gates.match_per_metre,
            match_known_square=gates.match_known,
            **self.view.model_dump(),
            lasting=(0.0, 0.0) if reports else LASTING,
        )
