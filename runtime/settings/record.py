"""[record]: where runs are kept and what goes into them."""

from pydantic import BaseModel, ConfigDict, Field


class RecordSettings(BaseModel):
    """Where runs are kept and what goes into them."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    folder: str = Field(
        "runs",
        min_length=1,
        description="Folder in which each run gets its own folder; --out names one run. Choose a disk that is "
        "large enough: `infant check` says for how many hours it lasts",
    )
    raw: bool = Field(
        True,
        description="Keep every byte of the laser and every CAN frame in addition to the ticks. Turn it off if the "
        "disk is small: then only two seconds around each laser error are kept",
    )
    segment_s: float = Field(
        60.0,
        ge=0.5,
        le=3600.0,
        description="Length of a segment; a closed segment is never touched again. Shorten it if power is cut "
        "often: only the last, open segment has to be repaired",
    )
    budget_gb: float = Field(
        0.0,
        ge=0.0,
        le=100_000.0,
        description="Space that all runs in the folder may take together; beyond it the oldest unmarked segments "
        "are removed. 0 means no limit, and other runs are never touched. Set it on a rover that "
        "nobody visits",
    )
    keep_free_gb: float = Field(
        0.5,
        ge=0.0,
        le=100_000.0,
        description="Space to leave free on the disk: a system without free space does not start again. The oldest "
        "unmarked segments of this run are removed for it. Raise it if other programs write to the "
        "disk too",
    )
    remove_older_runs: bool = Field(
        False,
        description="Whether unmarked segments of older runs are removed for keep_free_gb too, before those of "
        "this run. Turn it on if a disk full of old runs must not cost the new one",
    )
