"""Where on earth a map lies."""

import math

from pydantic import BaseModel, ConfigDict, Field

from runtime.errors import UsageError


class MapOrigin(BaseModel):
    """WGS 84 of the map's x = y = 0, which is where the first drive in it began. heading_deg: of its x axis, from east
    towards north.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    latitude_deg: float = Field(ge=-89.0, le=89.0)
    longitude_deg: float = Field(ge=-180.0, le=180.0)
    heading_deg: float = Field(0.0, ge=-360.0, le=360.0)


def parse_origin(text: str) -> MapOrigin:
    """LATITUDE,LONGITUDE[,HEADING] in degrees. Raises UsageError."""
    try:
        numbers = [float(word) for word in text.split(",")]
        if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
            raise ValueError(text)
        return MapOrigin(latitude_deg=numbers[0], longitude_deg=numbers[1], heading_deg=(*numbers, 0.0)[2])
    except ValueError as error:
        raise UsageError(
            f"--origin {text}: expected LATITUDE,LONGITUDE[,HEADING] in degrees, latitude within 89 and longitude "
            "within 180, for example 59.9139,10.7522,90"
        ) from error
