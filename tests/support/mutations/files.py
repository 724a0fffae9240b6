"""Files as somebody careless or hostile may leave them: drawn by a seed, so that each can be made again."""

import dataclasses
import random
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from rosbags.serde import SerdeError

from runtime.messages.definitions import TYPES, deserialize, serialize
from runtime.messages.tick import Record

WORDS = (
    *(
        b"\0",
        b"\x1b",
        b"\n",
        b"[",
        b"]",
        b"{",
        b"}",
        b'"',
        b"'''",
        b"=",
        b".",
        b"#",
        b"\r",
        b"\\",
        b'"\\u001b"',
        b"\xff\xfe",
    ),
    *(
        b"nan",
        b"inf",
        b"1e999",
        b"-1",
        b"9" * 400,
        b"9" * 5000,
        b"true",
        b"[[",
        b"]]",
        b'""',
        b"[]",
        b"{}",
        b"1979-05-27",
    ),
    *(b"a." * 300, b"[" * 2000, b"{a=" * 500, b"\xef\xbb\xbf"),
)
VALUES = (b"-5", b"1e30", b"0", b"0.0", b'"x"', b"[1, 2]", b"{x = 1}", *WORDS)
NUMBERS = (
    *(b"\0" * 8, b"\xff" * 8, struct.pack("<q", 1 << 62), struct.pack("<q", -(1 << 62))),
    *(struct.pack("<d", value) for value in (float("nan"), float("inf"), 1e300, -1e300, 5e-324)),
    *(struct.pack("<i", value) for value in (-1, 100, 1_000_000, 2**31 - 1)),
    *(struct.pack("<I", 0x7F800001), struct.pack("<Q", 0x7FF0000000000001)),  # signalling NaN
)


def mutated_text(rng: random.Random, text: bytes, others: Sequence[bytes]) -> bytes:
    """A text with one to ten changes; others: texts of which pieces are put in."""
    data = bytearray(text)
    for _ in range(rng.choice((1, 1, 2, 4, 10))):
        at = rng.randrange(max(1, len(data)))
        match rng.randrange(6):
            case 0:
                data[at : at + 1] = rng.randbytes(1)
            case 1:
                data[at:at] = rng.choice(WORDS)
            case 2:
                del data[at : at + rng.choice((1, 3, 20, 200))]
            case 3:
                other = rng.choice(others)
                begin = rng.randrange(len(other))
                data[at:at] = other[begin : begin + rng.randrange(200)]
            case 4:
                lines = bytes(data).split(b"\n")
                line = rng.randrange(len(lines))
                lines[line] = lines[line].split(b"=")[0] + b"= " + rng.choice(VALUES)
                data = bytearray(b"\n".join(lines))
            case 5:
                lines = bytes(data).split(b"\n")
                rng.shuffle(lines)
                data = bytearray(b"\n".join(lines))
    return bytes(data)


def mutated_bytes(rng: random.Random, content: bytes) -> bytes:
    """Bytes with one to five changes: bits, numbers that are none, cuts, and more than belongs there."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 5))):
        at = rng.randrange(max(1, len(data)))
        if rng.random() < 0.5:  # what decides stands at the beginning
            at = rng.randrange(4, max(5, min(len(data), 120)))
        match rng.randrange(5):
            case 0:
                data[at : at + 1] = bytes((data[at] ^ 1 << rng.randrange(8),)) if at < len(data) else b""
            case 1 | 2:
                number = rng.choice(NUMBERS)
                data[at - at % 4 : at - at % 4 + len(number)] = number
            case 3:
                del data[at:]
            case 4:
                data[at:at] = rng.randbytes(rng.choice((1, 4, 8, 400)))
    return bytes(data)


FIGURES = (*(float(number) for number in ("nan", "inf", "-inf", "0", "-1", "1e300", "3e38", "5e-324", "4e9")), 2.0**62)
SIGNALLING = np.array([0x7FF0000000000001], np.uint64).view(np.float64)  # a NaN that warns where it is made wider
SIGNALLING_32 = np.array([0x7F800001], np.uint32).view(np.float32)


def mutated_message(rng: random.Random, record: Record) -> Record:
    """A message that says another thing in one or two of its fields, as its type allows."""
    name = TYPES.get(record.topic)
    if name is None:
        return record
    try:
        message = deserialize(name, record.data)
    except ValueError:  # changed before, into no message
        return record
    for _ in range(rng.choice((1, 1, 2))):
        field = rng.choice([field.name for field in dataclasses.fields(message) if field.name != "__msgtype__"])
        setattr(message, field, _odd(rng, getattr(message, field)))
    try:
        with np.errstate(all="ignore"):
            return dataclasses.replace(record, data=serialize(name, message))
    except (SerdeError, ValueError, TypeError, OverflowError, struct.error, AssertionError):  # what no message can say
        return record


def _odd(rng: random.Random, value: Any) -> Any:
    match value:
        case np.ndarray():
            return _odd_array(rng, value.copy())
        case bool():
            return not value
        case int():
            return rng.choice((0, 1, -1, 2, 255, 2**31 - 1, -(2**31), 2**62, -(2**62), value + 1))
        case float():
            return rng.choice((*FIGURES, float(SIGNALLING[0])))
        case str():
            return rng.choice(("", "\x1b[2J\n", "a" * 10_000, "\ufeff\u202e"))
        case list():
            return rng.choice((value[:-1], value * 2, []))
    return value


def _odd_array(rng: random.Random, array: "np.ndarray[Any, Any]") -> "np.ndarray[Any, Any]":
    kind = rng.randrange(4)
    if array.size == 0:
        return np.zeros(rng.choice((1, 3, 1081)), array.dtype)
    if kind == 0:
        return array[: rng.randrange(array.size + 1)]
    if kind == 1:
        return np.concatenate((array, array[: rng.choice((1, 3, array.size))]))
    if kind == 2 and array.size > 1:
        return np.ascontiguousarray(array[::-1])
    at = slice(None) if rng.random() < 0.5 else rng.randrange(array.size)
    if array.dtype.kind == "f":
        odd: Any = SIGNALLING_32 if array.dtype.itemsize == 4 else SIGNALLING
        with np.errstate(all="ignore"):
            array[at] = odd[0] if rng.random() < 0.3 else rng.choice(FIGURES)
    else:
        limits = np.iinfo(array.dtype)
        array[at] = rng.choice((0, 1, int(limits.min), int(limits.max)))
    return array


def mutated_ticks(rng: random.Random, ticks: Sequence[list[Record]]) -> list[list[Record]]:
    """Ticks as records, up to three of which say something else; written again, all their checksums are right."""
    mutated = [list(records) for records in ticks]
    for _ in range(rng.choice((1, 1, 3))):
        records = rng.choice(mutated)
        at = rng.randrange(len(records))
        if rng.random() < 0.6:  # those that most is made of
            wanted = rng.choice(("/tick", "/scan", "/estimate"))
            at = next((place for place, record in enumerate(records) if record.topic == wanted), at)
        record = records[at]
        if rng.random() < 0.5:
            records[at] = mutated_message(rng, record)
        else:
            records[at] = Record(record.topic, record.stamp_ns, mutated_bytes(rng, record.data))
    return mutated
