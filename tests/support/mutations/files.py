"""Files as somebody careless or hostile may leave them: drawn by a seed, so that each can be made again."""

import random
import struct
from collections.abc import Sequence

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
        records[at] = Record(record.topic, record.stamp_ns, mutated_bytes(rng, record.data))
    return mutated
