"""[slam.front_end]: how beams become point features."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from slam.settings.alignment import AlignmentSettings


class FrontEndSettings(BaseModel):
    """How beams become point features, and how exact a feature is: what the sensor and the place ask for."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["robust", "paper", "given"] = Field(
        default="robust",
        description="robust: segments and corners after a compensated vote; paper: as printed in III-A, for studies; "
        "given: for a sensor that already tells its landmarks apart",
    )
    sigma_range_m: float = Field(
        default=0.02,
        gt=0.0,
        le=5.0,
        description="standard deviation of one range, m. From the data sheet (Hokuyo: 0.01 to 0.03); "
        "`infant calibrate` measures it",
    )
    sigma_bearing_rad: float = Field(
        default=0.0022,
        gt=0.0,
        le=0.5,
        description="standard deviation of a bearing, rad, for paper and given: half the angle between two beams, or "
        "what a camera is known to err by",
    )
    sigma_range_floor_m: float = Field(
        default=0.01,
        ge=0.0,
        le=5.0,
        description="no feature's range is more exact, m. What things that are not round or not sharp add: larger "
        "among trees (0.7 in Victoria Park) and for coarse sensors",
    )
    sigma_bearing_floor_rad: float = Field(
        default=0.0005,
        ge=0.0,
        le=0.5,
        description="no feature's bearing is more exact, rad: half the angle between two beams of a coarse sensor",
    )
    range_min_m: float = Field(
        default=0.1,
        ge=0.0,
        le=10.0,
        description="nearer returns are not used, m. Raise it where the laser sees parts of the vehicle",
    )
    range_max_m: float = Field(
        default=60.0,
        gt=0.0,
        le=500.0,
        description="returns from beyond are not used, m; the scan's own limit holds too. Set it where a sensor's far "
        "returns cannot be trusted, as slam.view.range_max_m",
    )
    width_max_m: float = Field(
        default=0.9,
        gt=0.0,
        le=5.0,
        description="wider segments are no trunk, m. The thickest round thing of the place: 0.4 indoors (posts, chair "
        "legs), 2 among old trees seen by few beams",
    )
    wall_corners: bool = Field(
        default=True,
        description="corners and free ends of walls are features as well. Off where there are no walls, as in a park: "
        "hedges have no corners",
    )
    alignment: AlignmentSettings = Field(
        default_factory=AlignmentSettings, description="scans that come seconds apart are laid onto each other"
    )
