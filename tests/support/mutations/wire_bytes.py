"""Bytes as they come off a bad wire, or from somebody who means harm."""

import numpy as np

Rng = np.random.Generator
ODD_BYTES = (b"", b"\n", b"\n\n", b"\0", b"\xff" * 8, b";", b"99b\n", b"00P\n", b"\x1b[2J", b"oooo")


def mutated(data: bytes, rng: Rng) -> bytes:
    """One to four changes: a bit, a byte, a piece cut out, doubled, moved or put in."""
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        size = len(changed)
        at = int(rng.integers(0, size + 1))
        until = min(size, at + int(rng.integers(1, 9)))
        match int(rng.integers(0, 7)):
            case 0 if at < size:
                changed[at] ^= 1 << int(rng.integers(0, 8))
            case 1 if at < size:
                changed[at] = int(rng.integers(0, 256))
            case 2:
                del changed[at:until]
            case 3:
                changed[at:at] = changed[at:until]
            case 4:
                del changed[at:]
            case 5:
                changed[at:at] = ODD_BYTES[int(rng.integers(0, len(ODD_BYTES)))]
            case _:
                changed += bytes(rng.integers(0, 256, int(rng.integers(1, 40)), dtype=np.uint8))
    return bytes(changed)
