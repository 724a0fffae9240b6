"""Records of a file that anyone may have written: each is decoded, or refused in a sentence that names its place."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from runtime.errors import NotARunError
from runtime.messages.definitions import TYPES, deserialize
from runtime.messages.estimate import decode_estimate
from runtime.messages.ros import decode_ranges_m
from runtime.messages.tick import (
    Record,
    decode_defect,
    decode_gap,
    decode_laser_bytes,
    decode_state_hash,
    decode_tick,
    decode_timing,
    decode_truth,
)
from runtime.printable import printable

Decoded = TypeVar("Decoded")
DECODERS: dict[str, Callable[[bytes], Any]] = {
    "/timing": decode_timing,
    "/state_hash": decode_state_hash,
    "/truth": decode_truth,
    "/defect": decode_defect,
    "/gap": decode_gap,
    "/raw/laser": decode_laser_bytes,
}
"""Topics of which more is made than their message, by that alone."""


def decoded(record: Record, decoder: Callable[[bytes], Decoded], place: str) -> Decoded:
    """What a record says. place: file and byte, for the message. Raises NotARunError where it says nothing."""
    try:
        return decoder(record.data)
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, ArithmeticError) as error:
        raise NotARunError(
            f"{place}: an invalid record of {printable(record.topic)} "
            f"({printable(str(error), 300)}); infant log recover leaves out what is damaged"
        ) from error


@dataclass(slots=True)
class Before:
    """What a record is judged by. ranges_m: of a scan whose tick is still to come; beams: of the scan of the last tick,
    None without one.
    """

    ranges_m: NDArray[np.float32] | None = None
    beams: int | None = None


def check(record: Record, before: Before, place: str) -> None:
    """Decode a record for nothing but to see that it can be; topics that are not known pass. Raises NotARunError.

    before: changed to what the next record is judged by.
    """
    match record.topic:
        case "/tick":
            tick = decoded(record, lambda data: decode_tick(data, before.ranges_m), place)
            before.ranges_m, before.beams = None, tick.beams
        case "/scan":
            before.ranges_m = decoded(record, decode_ranges_m, place)
        case "/estimate":
            decoded(record, lambda data: decode_estimate(data, before.beams), place)
        case topic if topic in DECODERS:
            decoded(record, DECODERS[topic], place)
        case topic if topic in TYPES:
            decoded(record, lambda data: deserialize(TYPES[topic], data), place)
