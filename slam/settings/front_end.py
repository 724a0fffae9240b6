"""Numbers of the front ends; the defaults are common to all data sets."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from slam.settings.alignment import AlignmentSettings


class FrontEndSettings(BaseModel):
    """How beams become point features, and how exact a feature is taken to be."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["robust", "paper", "given"] = Field(
        default="robust",
        description="robust: segments and corners after a compensated vote; paper: as printed in III-A; "
        "given: the sensor already tells its landmarks apart",
    )
    sigma_range_m: float = Field(
        default=0.02,
        gt=0.0,
        le=5.0,
        description="standard deviation of one range, m; 0.01 to 0.03 on Hokuyo's data sheets",
    )
    sigma_bearing_rad: float = Field(
        default=0.0022,
        gt=0.0,
        le=0.5,
        description="standard deviation of a bearing, rad, for paper and given; half the 0.25 deg between two beams",
    )
    sigma_range_floor_m: float = Field(
        default=0.01,
        ge=0.0,
        le=5.0,
        description="no feature's range is more exact, m; what a trunk that is not round adds",
    )
    sigma_bearing_floor_rad: float = Field(
        default=0.0005, ge=0.0, le=0.5, description="no feature's bearing is more exact, rad"
    )
    range_min_m: float = Field(default=0.1, ge=0.0, le=10.0, description="nearer returns are not used, m")
    range_max_m: float = Field(
        default=60.0,
        gt=0.0,
        le=500.0,
        description="farther features are not used, m; the scan's own limit holds too",
    )
    spacing_m: float = Field(
        default=0.10,
        ge=0.0,
        le=10.0,
        description="technique 2: least distance of two features, m; paper: 0.10",
    )

    youngest_s: float = Field(
        default=0.4,
        ge=0.0,
        le=10.0,
        description="age from which a scan is compared with, s; 0.5 s is a walker's step",
    )
    oldest_s: float = Field(
        default=1.1,
        gt=0.0,
        le=10.0,
        description="age up to which a scan is compared with, s; odometry is good so long",
    )
    votes: int = Field(default=5, ge=1, le=20, description="at most so many earlier scans are compared with")
    support_share: float = Field(
        default=0.65,
        ge=0.0,
        le=1.0,
        description="least share of the scans that looked there and found it there too",
    )
    least_support: int = Field(
        default=2,
        ge=1,
        le=20,
        description="least number of scans that found it there too, where so many were compared",
    )
    tolerance_m: float = Field(
        default=0.12,
        gt=0.0,
        le=5.0,
        description="there means within this distance, m; a fifth of what a walker goes in 0.5 s",
    )
    tolerance_rad: float = Field(
        default=0.006,
        ge=0.0,
        le=0.2,
        description="and this much more per metre of range: heading error of odometry over 1 s, rad",
    )
    feature_tolerance_m: float = Field(
        default=0.08,
        gt=0.0,
        le=5.0,
        description="the same for features, m: twice the spread of a trunk's centre and a slip of 1 percent",
    )
    difference_m: float = Field(
        default=0.10,
        gt=0.0,
        le=5.0,
        description="paper: equal beams of two scans differ by less, m; not given in print",
    )

    gap_m: float = Field(
        default=0.10,
        gt=0.0,
        le=2.0,
        description="neighbouring returns farther apart are of two things, m, plus gap_beams",
    )
    gap_beams: float = Field(
        default=3.0,
        ge=1.0,
        le=20.0,
        description="times the beams' own distance at that range; 3 follows a wall up to 70 deg of incidence",
    )
    bridge_beams: int = Field(default=1, ge=0, le=10, description="so many empty beams do not end a segment")
    guard_beams: int = Field(
        default=2,
        ge=1,
        le=50,
        description="so many beams beside a segment must not fall on anything near it",
    )
    width_max_m: float = Field(
        default=0.9,
        gt=0.0,
        le=5.0,
        description="wider segments are no trunk, m; the world's thickest are 0.7",
    )
    prominence_m: float = Field(
        default=0.3, gt=0.0, le=10.0, description="what is beside a segment is behind it by this, m"
    )
    thin_prominence_m: float = Field(
        default=0.6,
        gt=0.0,
        le=10.0,
        description="the same for segments of one or two beams, m: noise has such dips too",
    )
    roughness: float = Field(
        default=0.12,
        gt=0.0,
        le=2.0,
        description="RMS distance from a round trunk, in radii, beyond which a segment is none; a flat board has 0.22",
    )

    wall_corners: bool = Field(default=True, description="corners and free ends of walls are features as well")
    line_split_m: float = Field(
        default=0.08, gt=0.0, le=1.0, description="a wall bends where a point is so far off the chord, m"
    )
    line_rms_m: float = Field(
        default=0.03,
        gt=0.0,
        le=1.0,
        description="RMS distance from a line, m, beyond which it is taken for a hedge",
    )
    line_beams: int = Field(default=4, ge=3, le=200, description="least number of beams on a wall")
    line_m: float = Field(default=0.2, gt=0.0, le=10.0, description="least length of a wall, m")
    corner_rad: float = Field(default=0.7, gt=0.1, le=1.57, description="least turn of a wall at a corner, rad")
    end_spacing_m: float = Field(
        default=0.12, gt=0.0, le=1.0, description="a wall's end is used if its beams are so close there, m"
    )
    sigma_corner_m: float = Field(
        default=0.02,
        ge=0.0,
        le=1.0,
        description="how far a corner is from the meeting of two lines, m; real ones are blunt",
    )
    alignment: AlignmentSettings = Field(
        default_factory=AlignmentSettings, description="scans that come seconds apart are laid onto each other"
    )
