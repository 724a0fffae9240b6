"""[map]: the map that drives begin in."""

from pydantic import BaseModel, ConfigDict, Field


class MapSettings(BaseModel):
    """A map that an earlier drive has left (`infant map save`)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    file: str | None = Field(
        None,
        min_length=1,
        description="map that a run begins in, as `infant run --map` does for one run. Set it where the rover always "
        "drives in the same place; without it every run makes a map of its own",
    )
