"""What a tool believes of an answer on infant/<rover>/status: anyone may have sent it."""

import re
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from runtime.printable import printable

LARGEST_BYTES = 64 << 10  # a status has 2 kB
LONGEST_TEXT = 1000  # characters shown; a rover in trouble may say more, and must be seen all the same
ROVER = re.compile(r"[A-Za-z0-9_-]{1,32}")
KEY = re.compile(rf"infant/({ROVER.pattern})/status")

Number = Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=1 << 62)]
Stamp = Annotated[int, Field(ge=-(1 << 62), le=1 << 62)]
Name = Annotated[str, Field(max_length=64)]


class _Part(BaseModel):
    model_config = ConfigDict(strict=True, extra="ignore")


class _Pose(_Part):
    x_m: Number
    y_m: Number
    heading_rad: Number


class _Sensor(_Part):
    state: Name
    reason: str
    rate_hz: Number
    counters: Annotated[dict[Name, Count], Field(max_length=200)] = {}
    figures: Annotated[dict[Name, Number | None], Field(max_length=200)] = {}
    facts: Annotated[dict[Name, str], Field(max_length=50)] = {}


class _Sink(_Part):
    depth: Count
    dropped: Count
    trouble: str


class _Map(_Part):
    id: Count
    for_s: Number
    recognised_s_ago: Number | None
    by_scans: bool | None = None
    matches: Count | None
    odds: Number | None
    mirror_odds: Number | None


class RoverStatus(_Part):
    """The fields of runtime.publish.messages.status_object, each with its bounds."""

    rover: Name
    stamp_ns: Stamp
    state: Name | None
    reasons: Annotated[list[str], Field(max_length=50)]
    rate_hz: Number
    seq: Count | None
    quality: Name | None
    lateness_ms: Number | None
    step_ms: Number | None
    pose: _Pose | None
    sigma: _Pose | None
    landmarks: Count | None
    filter: Annotated[dict[Name, Number], Field(max_length=20)] | None = None
    map: _Map | None = None
    sensors: Annotated[dict[Name, _Sensor], Field(max_length=20)]
    sinks: Annotated[dict[Name, _Sink], Field(max_length=20)]
    listening: Annotated[list[str], Field(max_length=20)] = []
    host: Name = ""
    instance: Name = ""


def believed(key: str, payload: bytes) -> dict[str, Any]:
    """The status in an answer, its texts printable and cut. Raises ValueError with a sentence where it is none."""
    match = KEY.fullmatch(key)
    if match is None:
        raise ValueError(f"{printable(key, 100)} is not the status of a rover")
    if len(payload) > LARGEST_BYTES:
        raise ValueError(f"{key} holds {len(payload)} bytes, a status has at most {LARGEST_BYTES}")
    try:
        status = RoverStatus.model_validate_json(payload)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"])) or "its text"
        why = printable(f"{where}: {first['msg']}", 200)
        raise ValueError(f"{key} is not a valid status: {why}") from error
    if status.rover != match[1]:
        raise ValueError(f"{key} claims to be {printable(status.rover)}")
    of_a_tick = (status.seq, status.sigma, status.lateness_ms, status.landmarks)
    if any((each is None) != (status.pose is None) for each in of_a_tick):
        raise ValueError(f"{key} holds an incomplete pose")
    cleaned: dict[str, Any] = _printable(status.model_dump())
    return cleaned


def _printable(value: Any) -> Any:
    match value:
        case str():
            return printable(value, LONGEST_TEXT)
        case dict():
            return {printable(key): _printable(each) for key, each in value.items()}
        case list():
            return [_printable(each) for each in value]
    return value
