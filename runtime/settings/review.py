"""Settings of the picture that a run leaves behind (review.rrd)."""

from pydantic import BaseModel, ConfigDict, Field


class ReviewSettings(BaseModel):
    """How much of a run is drawn. Everything can be drawn again from run.mcap with other settings."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    live: bool = Field(
        True,
        description="Draw review.rrd while driving, in another process; `infant review` can draw it later. Turn it "
        "off on a computer without two cores to spare",
    )
    scan_every: int = Field(1, ge=1, le=100, description="laser points of every n-th tick: most of the file")
