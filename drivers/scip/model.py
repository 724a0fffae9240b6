"""What a laser says of itself: parameters (PP), version (VV), state (II); nothing of a model is known beforehand."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from drivers.scip.codec import ScipError

SECONDS_PER_MINUTE = 60.0


class ParameterError(ScipError):
    """The device's own description lacks something or contradicts itself."""


@dataclass(frozen=True, slots=True)
class Parameters:
    """Geometry and speed of the sensor, from PP.

    Ranges in millimetres, steps are the device's own numbers; steps_per_turn is ARES, front_step is AFRT.
    """

    model: str
    range_min_mm: int
    range_max_mm: int
    steps_per_turn: int
    first_step: int
    last_step: int
    front_step: int
    speed_rpm: int

    @property
    def period_s(self) -> float:
        """Time of one turn of the mirror."""
        return SECONDS_PER_MINUTE / self.speed_rpm

    @property
    def step_period_s(self) -> float:
        """Time from one step to the next."""
        return self.period_s / self.steps_per_turn

    @property
    def step_rad(self) -> float:
        """Angle from one step to the next, counter-clockwise."""
        return 2.0 * math.pi / self.steps_per_turn

    def bearing_rad(self, step: float) -> float:
        """Bearing of a step in the laser's frame; the front step is 0."""
        return (step - self.front_step) * self.step_rad

    def key_values(self) -> dict[str, str]:
        """The eight lines of PP, in the order of the real sensor."""
        numbers = (
            self.range_min_mm,
            self.range_max_mm,
            self.steps_per_turn,
            self.first_step,
            self.last_step,
            self.front_step,
            self.speed_rpm,
        )
        return {"MODL": self.model} | {key: str(number) for key, number in zip(NUMBER_KEYS, numbers, strict=True)}


STEPS_PER_TURN = (36, 36_000)  # from 10 deg to 0.01 deg a step; real ones have 1024 to 5760
SPEEDS_RPM = (60, 12_000)  # one to 200 turns a second; real ones make 10 to 40
LEAST_RANGE_MM = 20  # of any of them, where one does not say
WHOLE_NUMBER = re.compile(r"\+?0*([0-9]{1,7})(?:\.0*)?(?: ?\[?(?:mm|rpm|r/min|step)\]?)?")  # also "+0023.0 [mm]"
NUMBER_KEYS = ("DMIN", "DMAX", "ARES", "AMIN", "AMAX", "AFRT", "SCAN")


def parse_parameters(values: Mapping[str, str]) -> Parameters:
    """Parameters out of the lines of PP; further keys are ignored. Raises ParameterError."""
    values = {"DMIN": str(LEAST_RANGE_MM)} | {key.strip().upper(): value for key, value in values.items()}
    numbers = []
    for key in NUMBER_KEYS:
        if key not in values:
            raise ParameterError(f"the laser's parameters (PP) lack {key}")
        text = values[key].strip()  # some firmware puts a blank behind the colon
        if not (number := WHOLE_NUMBER.fullmatch(text)):
            raise ParameterError(f"the laser's parameter {key} is {text[:20]!r}, expected a whole number")
        numbers.append(int(number[1]))
    parameters = Parameters(values.get("MODL", "unknown"), *numbers)
    sound = (
        0 <= parameters.first_step < parameters.last_step <= 9999
        and parameters.last_step - parameters.first_step < parameters.steps_per_turn
        and parameters.range_min_mm < parameters.range_max_mm
    )
    if not sound:
        raise ParameterError(f"the laser's parameters contradict each other: {parameters}")
    for key, (low, high) in {
        "ARES": STEPS_PER_TURN,
        "AFRT": (0, parameters.steps_per_turn),
        "SCAN": SPEEDS_RPM,
    }.items():
        told = numbers[NUMBER_KEYS.index(key)]
        if not low <= told <= high:
            raise ParameterError(f"the laser's parameter {key} is {told}, expected {low} to {high}")
    return parameters


STATES_WITHOUT_TROUBLE = (
    "000 no error",
    "works well",
    "working normally",
    "failed to synchronize",  # UST: no master to follow, measures all the same
    "multiple master sensor",
)
WORDS_OF_TROUBLE = ("error", "abnormal", "malfunction", "trouble", "fail")


def reports_fault(state: str) -> bool:
    """True if STAT of II names a fault; a wording nobody has seen is not one, or an unknown model would never run."""
    text = state.lower()
    return not any(good in text for good in STATES_WITHOUT_TROUBLE) and any(bad in text for bad in WORDS_OF_TROUBLE)


def is_booting(measuring: str) -> bool:
    """True if MESM of II says that the device has just been switched on."""
    return measuring.startswith("001") or "boot" in measuring.lower()


class NoRange(StrEnum):
    """Why a beam has no range."""

    TOO_FAR = "too_far"
    TOO_NEAR = "too_near"
    WEAK = "weak"
    INTERFERENCE = "interference"
    MALFUNCTION = "malfunction"
    OTHER = "other"


# UTM-30LX and its relatives (DMAX above 20 m); of 4 drivers disagree: too far, or near the end of the range
LONG_RANGE_CODES = {
    0: NoRange.OTHER,
    1: NoRange.TOO_FAR,
    2: NoRange.TOO_NEAR,
    3: NoRange.INTERFERENCE,
    4: NoRange.TOO_FAR,
    5: NoRange.OTHER,
}
# URG-04LX
SHORT_RANGE_CODES = {
    0: NoRange.TOO_FAR,
    1: NoRange.WEAK,
    2: NoRange.WEAK,
    6: NoRange.TOO_FAR,
    7: NoRange.INTERFERENCE,
    8: NoRange.INTERFERENCE,
    9: NoRange.MALFUNCTION,
    18: NoRange.TOO_NEAR,
    19: NoRange.MALFUNCTION,
}
LONG_RANGE_MM = 20000

KNOWN_MODELS = ("UTM-30LX", "UTM-X001S", "UTM-X002S", "UST-", "URG-04LX", "UXM-30LX", "UBG-", "UHG-")


def range_code_meaning(parameters: Parameters, code: int) -> NoRange:
    """What a value below DMIN or above DMAX stands for on this sensor."""
    if code > parameters.range_max_mm:
        return NoRange.TOO_FAR
    table = LONG_RANGE_CODES if parameters.range_max_mm > LONG_RANGE_MM else SHORT_RANGE_CODES
    return table.get(code, NoRange.OTHER)
