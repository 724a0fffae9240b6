"""What the simulated world is made of, how the rover drives through it, and what its laser measures."""

import math
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Distance = Annotated[float, Field(ge=-1000.0, le=1000.0)]


class LaserGeometrySettings(BaseModel):
    """Beams and errors of the simulated laser; the defaults are those of the UTM-X001S at 10 Hz."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    beam_count: int = Field(default=1081, ge=2, le=4096, description="beams of one sweep, step 0 first")
    steps_per_revolution: int = Field(
        default=1440,
        ge=16,
        le=16384,
        description="steps of a full turn of the mirror; the beams are 2 pi divided by it apart",
    )
    first_bearing_rad: float = Field(
        default=math.radians(-135.0),
        ge=-math.pi,
        le=math.pi,
        description="bearing of step 0 in the laser frame, rad",
    )
    revolution_s: float = Field(
        default=0.1,
        ge=0.005,
        le=1.0,
        description="time of a full turn of the mirror, s; 10 Hz is the paper's rate",
    )
    range_max_m: float = Field(default=30.0, gt=1.0, le=200.0, description="nothing comes back from beyond, m")
    sigma_range_m: float = Field(
        default=0.015,
        ge=0.0,
        le=0.5,
        description="standard deviation of one range, m; 0.01 to 0.03 on Hokuyo's data sheets",
    )
    drop_out_share: float = Field(default=0.005, ge=0.0, le=1.0, description="share of beams that come back empty")
    mixed_share: float = Field(
        default=0.2,
        ge=0.0,
        le=1.0,
        description="share of beams next to a range jump that return something between both",
    )
    body_from_laser: tuple[Distance, Distance, Distance] = Field(
        default=(0.3, 0.0, 0.0), description="mount: x m, y m, heading rad of the laser in the body's frame"
    )
    upside_down: bool = Field(default=False, description="whether it hangs, so that its beams turn the other way")

    @property
    def beam_spacing_rad(self) -> float:
        """Angle from one beam to the next."""
        return 2.0 * math.pi / self.steps_per_revolution

    @property
    def beam_period_s(self) -> float:
        """Time from one beam to the next."""
        return self.revolution_s / self.steps_per_revolution


class DriveSettings(BaseModel):
    """Course and speed of the simulated rover."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    speed_mps: float = Field(
        default=0.5,
        ge=0.0,
        le=1.95,
        description="Cruising speed; 7 km/h is the limit of the paper's rover. Change it to see slower or faster "
        "drives",
    )
    rest_s: float = Field(
        default=2.0,
        ge=0.0,
        le=600.0,
        description="time at rest before it starts, s; the map's heading comes from these scans",
    )
    ramp_s: float = Field(default=1.5, ge=0.01, le=60.0, description="time from rest to cruising speed, s")
    tread_m: float = Field(default=0.5, gt=0.05, le=5.0, description="distance between the wheels, m; paper: 0.5")
    corners_m: tuple[tuple[Distance, Distance], ...] = Field(
        default=((4.0, 0.0), (4.0, 4.5), (0.0, 3.0), (-3.2, 5.4), (-4.0, 0.0)),
        min_length=3,
        description="corners of the closed course, m; it starts in the middle of the edge from the last to the "
        "first, which becomes the map's origin and x axis",
    )
    course_scale: float = Field(default=1.0, gt=0.1, le=100.0, description="factor on corners_m")
    corner_m: float = Field(
        default=1.6,
        gt=0.1,
        le=50.0,
        description="distance before a corner at which the turn begins, m, times course_scale",
    )


Place = Literal["park", "building", "corridor", "orchard", "empty"]


class KidnapSettings(BaseModel):
    """The rover is lifted and put down elsewhere; its wheels report nothing of it, and it drives on as before."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["kidnap"] = Field(default="kidnap", description="what happens")
    start_s: float = Field(default=0.0, ge=0.0, le=86400.0, description="s after the world began, or after it is typed")
    x_m: float = Field(default=2.0, ge=-100.0, le=100.0, description="m by which it is moved along x of the map")
    y_m: float = Field(default=1.0, ge=-100.0, le=100.0, description="m by which it is moved along y of the map")
    turn_deg: float = Field(default=60.0, ge=-180.0, le=180.0, description="degrees by which it is turned to the left")


class WorldSettings(BaseModel):
    """A place drawn from a seed: everything in it depends only on these settings and on time."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    seed: int = Field(
        default=1,
        ge=0,
        le=2**32 - 1,
        description="Seed of places, sizes, walks and measurement noise. Change it for another park",
    )
    place: Place = Field(
        default="park",
        description="What stands around the rover. park: posts, trees, bushes and walls; building: corridors in a ring "
        "with rooms, doors and glass; corridor: walls along the course with niches; orchard: rows of trunks; empty: "
        "only people. Change it to what you will drive in",
    )
    margin_m: float = Field(default=16.0, ge=2.0, le=200.0, description="how far the park reaches beyond the course, m")
    clearance_m: float = Field(default=1.2, ge=0.5, le=10.0, description="nothing fixed is nearer to the course, m")
    poles: int = Field(default=14, ge=0, le=2000, description="thin posts, radius 0.03 to 0.08 m")
    trees: int = Field(default=16, ge=0, le=2000, description="trunks, radius 0.10 to 0.35 m")
    bushes: int = Field(default=8, ge=0, le=500, description="irregular, half permeable; no landmark")
    walls: int = Field(default=4, ge=0, le=100, description="straight walls of 3 to 8 m")
    people: int = Field(
        default=7,
        ge=0,
        le=200,
        description="Number of people: crossing, walking along the course, standing and then leaving. Change it "
        "for a busier or an empty park",
    )
    kidnaps: tuple[KidnapSettings, ...] = Field(
        default=(),
        description="When the rover is lifted and put down elsewhere, such as `[{ start_s = 20, x_m = 2, y_m = 1, "
        "turn_deg = 60 }]`. Set it to see how the rover finds its way back",
    )
    drive: DriveSettings = DriveSettings()
    laser: LaserGeometrySettings = LaserGeometrySettings()
