"""What `infant smooth` has left in a run: path and landmarks as the whole run has them, and what they refute."""

from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from runtime.bounded_read import read_bounded
from runtime.errors import ConfigurationError, NotARunError
from runtime.evaluate.against_truth import path_error
from runtime.evaluate.rows import read_tum
from runtime.evaluate.truth import DataSetTruth, Mount
from runtime.record.folder import RunFolder

SMOOTHED = "smoothed"
"""Name of the path in TUM form (RunFolder.tum_path)."""
LARGEST_BYTES = 16 << 20
MOST_LISTED = 200  # of each kind, the gravest ones

_MODEL = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class WrongMatch(BaseModel):
    """A landmark that the filter took something else for, from one time to another (s since the first tick).

    off_m: how far what was seen is from the landmark, at the most. square: all squared Mahalanobis distances together.
    """

    model_config = _MODEL

    landmark: int
    start_s: float
    end_s: float
    sightings: int = Field(ge=1)
    off_m: float
    square: float


class Doubled(BaseModel):
    """Two landmarks, never seen together, that stand in one place as far as anybody can tell, x_m, y_m."""

    model_config = _MODEL

    first: int
    second: int
    apart_m: float
    x_m: float
    y_m: float


class Parting(BaseModel):
    """A time (s since the first tick) in which filter and smoothed path are farther apart than three sigma."""

    model_config = _MODEL

    start_s: float
    end_s: float
    apart_m: float
    sigmas: float


class SmoothedResult(BaseModel):
    """smoothed.json. estimates: name of the folder whose estimates were smoothed; scans: of them.

    noise: what the standard deviations of ranges, bearings and motions turned out to be, as shares of the configured
    ones. apart_rms_m: between the filter's path, while it was not lost, and the smoothed one after the best rigid
    fit; None where it always was.
    """

    model_config = _MODEL

    estimates: str
    configuration_sha256: str
    scans: int
    landmarks: int
    sightings: int
    refuted: int
    noise: dict[str, float]
    apart_rms_m: float | None
    wrong_matches: list[WrongMatch] = Field(max_length=MOST_LISTED)
    doubled: list[Doubled] = Field(max_length=MOST_LISTED)
    partings: list[Parting] = Field(max_length=MOST_LISTED)


def smoothed_json_path(folder: RunFolder) -> Path:
    """Where the result lies."""
    return folder.path / "smoothed.json"


def read_smoothed(folder: RunFolder, estimates: RunFolder) -> SmoothedResult | None:
    """The result in a run, None where there is none of these estimates. Raises NotARunError where it is no result."""
    path = smoothed_json_path(folder)
    if not path.is_file():
        return None
    try:
        found = SmoothedResult.model_validate_json(read_bounded(path, LARGEST_BYTES))
    except (OSError, ValueError, ValidationError) as error:
        why = f"{type(error).__name__}"
        raise NotARunError(
            f"{path} is not a result of infant smooth ({why}); remove it, or smooth the run again"
        ) from error
    return found if found.estimates == estimates.path.resolve().name else None


def against_smoothed(
    folder: RunFolder, estimates: RunFolder, truth: DataSetTruth | None, body_from_laser: Mount
) -> dict[str, Any]:
    """How far the filter is from the smoothed path, and that from the truth after a rigid fit; None where unknown.

    Raises NotARunError.
    """
    figures: dict[str, Any] = dict.fromkeys(("smoothed_apart_rms_m", "smoothed_rms_m", "smoothed_trimmed_rms_m"))
    result = read_smoothed(folder, estimates)
    if result is None:
        return figures
    figures["smoothed_apart_rms_m"] = result.apart_rms_m
    if truth is not None:
        try:
            rows = read_tum(folder.tum_path(SMOOTHED))
        except ConfigurationError as error:
            raise NotARunError(f"{error}; smooth the run again") from error
        position = path_error(rows, truth, body_from_laser).position
        if position is not None:
            figures |= {"smoothed_rms_m": position.rms_m, "smoothed_trimmed_rms_m": position.trimmed_rms_m}
    return figures


def smoothed_lines(figures: dict[str, Any]) -> list[str]:
    """The same for a person."""
    if figures["smoothed_apart_rms_m"] is None:
        return []
    lines = [
        f"smoothed  the filter is {figures['smoothed_apart_rms_m']:.3f} m RMS from the smoothed path after the best fit"
    ]
    if figures["smoothed_rms_m"] is not None:
        lines.append(
            f"          which is {figures['smoothed_rms_m']:.3f} m RMS (95 %-trimmed "
            f"{figures['smoothed_trimmed_rms_m']:.3f} m) from the truth after the best rigid fit"
        )
    return lines
