"""[map]: the map that drives begin in, and where on earth it lies."""

from pydantic import BaseModel, ConfigDict, Field


class MapOrigin(BaseModel):
    """Where on earth the map frame begins, which is where the first drive in it began, and how it is turned."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    latitude_deg: float = Field(ge=-89.0, le=89.0, description="WGS 84, of the map's x = y = 0")
    longitude_deg: float = Field(ge=-180.0, le=180.0, description="WGS 84, of the map's x = y = 0")
    heading_deg: float = Field(0.0, ge=-360.0, le=360.0, description="of the map's x axis, from east towards north")


class MapSettings(BaseModel):
    """A map that an earlier drive has left (`infant map save`)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    file: str | None = Field(
        None,
        min_length=1,
        description="map that a run begins in, as `infant run --map` does for one run. Set it where the rover always "
        "drives in the same place; without it every run makes a map of its own",
    )
    origin: MapOrigin | None = Field(
        None,
        description="where on earth the map of a run that begins without one lies; survey the place where it starts. "
        "Saved maps keep it, and GeoJSON is then in degrees",
    )
