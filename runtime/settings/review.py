"""Settings of the picture that a run leaves behind (review.rrd)."""

from pydantic import BaseModel, ConfigDict, Field


class ReviewSettings(BaseModel):
    """How much of a run is drawn. All of it can be made again from run.mcap with other settings."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    live: bool = Field(True, description="draw while driving, in another process; infant review can do it later")
    scan_every: int = Field(1, ge=1, le=100, description="laser points of every n-th tick: most of the file")
    trace_every: int = Field(10, ge=1, le=1000, description="ticks between the scans that stay and add up to a map")
    particles_every: int = Field(1, ge=1, le=100, description="particles of every n-th tick")
    batch_ticks: int = Field(10, ge=1, le=1000, description="ticks per write: 1 s, which a power cut loses")
    queue: int = Field(
        4000, ge=100, le=100000, description="records that may wait for the drawing process; 40 s at 100 records/s"
    )
    sigmas: float = Field(2.0, gt=0.0, le=10.0, description="half axes of covariance ellipses, in standard deviations")
