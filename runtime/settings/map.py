"""[map]: the map that drives begin in."""

from pydantic import BaseModel, ConfigDict, Field


class MapSettings(BaseModel):
    """A map from an earlier drive (`infant map save`)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    file: str | None = Field(
        None,
        min_length=1,
        description="The map in which every run begins, as `infant run --map` does for one run. Set it if the "
        "rover always drives in the same place; without it every run makes its own map",
    )
