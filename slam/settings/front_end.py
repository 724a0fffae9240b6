"""[slam.front_end]: how beams become point features."""

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from slam.settings.alignment import AlignmentSettings

GIVEN_NOISE = {"sigma_range_m": 0.3, "sigma_bearing_rad": 0.05}
"""Of a sensor that reports landmarks, where nobody says how good it is: as a camera's distances by size."""


class FrontEndSettings(BaseModel):
    """How beams become point features, and how accurate a feature is.

    These values depend on the sensor and the place.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["robust", "paper", "given"] = Field(
        default="robust",
        description="robust: segments and corners, confirmed by a motion-compensated vote; paper: as printed in "
        "III-A, for studies; given: for a sensor that identifies its landmarks itself. Keep robust for "
        "a laser",
    )
    sigma_range_m: float = Field(
        default=0.02,
        ge=1e-4,
        le=5.0,
        description="Standard deviation of one range. Take it from the data sheet (Hokuyo: 0.01 to 0.03) or "
        "measure it with `infant calibrate`",
    )
    sigma_bearing_rad: float = Field(
        default=0.0022,
        ge=1e-5,
        le=0.5,
        description="Standard deviation of a bearing, used by the kinds paper and given. Take half the angle "
        "between two beams, or the known error of the camera",
    )
    sigma_range_floor_m: float = Field(
        default=0.05,
        ge=0.0,
        le=5.0,
        description="Smallest standard deviation of a feature's range, for things that are not round or have no "
        "sharp edge. Raise it among trees (0.7 in Victoria Park)",
    )
    sigma_bearing_floor_rad: float = Field(
        default=0.01,
        ge=0.0,
        le=0.5,
        description="Smallest standard deviation of a feature's bearing: from elsewhere, another part of a thing "
        "is seen. Raise it among trees (0.03 in Victoria Park)",
    )
    range_min_m: float = Field(
        default=0.1,
        ge=0.0,
        le=10.0,
        description="Returns closer than this are ignored. Raise it if the laser sees parts of the vehicle",
    )
    range_max_m: float = Field(
        default=60.0,
        ge=0.5,
        le=500.0,
        description="Returns farther than this are ignored; the limit of the scan itself applies too. Lower it, "
        "like slam.view.range_max_m, if the sensor's far returns cannot be trusted",
    )
    width_max_m: float = Field(
        default=0.9,
        ge=0.02,
        le=5.0,
        description="Segments wider than this are not trunks. Take the thickest round object of the place: 0.4 "
        "indoors (posts, chair legs), 2 among old trees that few beams hit",
    )
    wall_corners: bool = Field(
        default=True,
        description="Use corners and free ends of walls as features too. Turn it off where there are no walls, as "
        "in a park: hedges have no corners",
    )
    alignment: AlignmentSettings = Field(
        default_factory=AlignmentSettings, description="Alignment of scans that are seconds apart"
    )

    @model_validator(mode="after")
    def _leaves_returns(self) -> Self:
        if self.range_min_m >= self.range_max_m:
            raise ValueError(f"range_min_m below range_max_m, not {self.range_min_m} and {self.range_max_m}")
        return self
