"""[record]: where runs are kept and what goes into them."""

from pydantic import BaseModel, ConfigDict, Field


class RecordSettings(BaseModel):
    """Where runs are kept and what goes into them."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    folder: str = Field(
        "runs",
        min_length=1,
        description="each run becomes a folder in here; --out names one run. Put it on a disk that is large "
        "enough: `infant check` says for how many hours",
    )
    raw: bool = Field(
        True,
        description="keep every byte of the laser and every CAN frame beside the ticks. Off where the disk is "
        "small: then only two seconds around each error of the laser are kept",
    )
    segment_s: float = Field(
        60.0,
        ge=0.5,
        le=3600.0,
        description="s after which a segment is closed and never touched again. Shorter where power is cut often: "
        "the last open one is repaired by reading it",
    )
    budget_gb: float = Field(
        0.0,
        ge=0.0,
        le=100_000.0,
        description="all runs in the folder may take this much; beyond it the oldest segments go that nobody "
        "marked. 0: no limit, and runs other than this one are never touched. Set it on a rover that nobody visits",
    )
    keep_free_gb: float = Field(
        0.5,
        ge=0.0,
        le=100_000.0,
        description="leave this much of the disk free: a system without space does not start again. The oldest "
        "unmarked segments of this run go for it. Raise it where others write to the disk too",
    )
    remove_older_runs: bool = Field(
        False,
        description="let unmarked segments of older runs in the folder go for keep_free_gb too, before those of this "
        "run. On where a card full of old runs must not cost the new one",
    )
