"""Records of a file that anyone may have written: each is decoded, or refused in a sentence that names its place."""

from collections.abc import Callable
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
    "/scan": decode_ranges_m,
    "/estimate": decode_estimate,
    "/timing": decode_timing,
    "/state_hash": decode_state_hash,
    "/truth": decode_truth,
    "/defect": decode_defect,
    "/gap": decode_gap,
    "/raw/laser": decode_laser_bytes,
}
"""Topics of which more is made than their message; /tick also needs the scan before it."""


def decoded(record: Record, decoder: Callable[[bytes], Decoded], place: str) -> Decoded:
    """What a record says. place: file and byte, for the message. Raises NotARunError where it says nothing."""
    try:
        return decoder(record.data)
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, ArithmeticError) as error:
        raise NotARunError(
            f"{place}: an invalid record of {printable(record.topic)} "
            f"({printable(str(error), 300)}); infant log recover leaves out what is damaged"
        ) from error


def check(record: Record, ranges_m: NDArray[np.float32] | None, place: str) -> NDArray[np.float32] | None:
    """Decode a record for nothing but to see that it can be; topics that are not known pass.

    ranges_m: of the scan before a tick; returned is what the next record needs. Raises NotARunError.
    """
    if record.topic == "/tick":
        decoded(record, lambda data: decode_tick(data, ranges_m), place)
        return None
    if record.topic in DECODERS:
        value = decoded(record, DECODERS[record.topic], place)
        return value if record.topic == "/scan" else ranges_m
    if record.topic in TYPES:
        decoded(record, lambda data: deserialize(TYPES[record.topic], data), place)
    return ranges_m
