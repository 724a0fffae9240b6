"""The identity of a publisher as rmw_zenoh makes it: XXH3, 128 bits, seed 0, of its liveliness key.

Only for texts of 17 to 1024 bytes, which every liveliness key is. Source of the algorithm: Cyan4973/xxHash,
doc/xxhash_spec.md.
"""

import struct
from functools import reduce

MASK = (1 << 64) - 1
PRIME32 = (0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D)
PRIME64 = (0x9E3779B185EBCA87, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x85EBCA77C2B2AE63, 0x27D4EB2F165667C5)
SECRET = bytes.fromhex(
    "b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671fcb79e64eccc0e578825ad07dccff7221"
    "b8084674f743248ee03590e6813a264c3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8"
    "a8fa763fe39c343ff9dcbbc7c70b4f1d8a51e04bcdb45931c89f7ec9d9787364eac5ac8334d3ebc3c581a0fffa1363eb"
    "170ddd51b7f0da49d316552629d4689e2b16be587d47a1fc8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e"
)
SHORTEST, MEDIUM, LONG, LONGEST = 17, 129, 241, 1024  # lengths from which on another form holds, and the last of all
STRIPE = 64


def publisher_gid(token: str) -> bytes:
    """Sixteen bytes; token: the liveliness key. Raises ValueError for a length that no such key has."""
    data = token.encode()
    if not SHORTEST <= len(data) <= LONGEST:
        raise ValueError(f"{len(data)} bytes, expected {SHORTEST} to {LONGEST}")
    return struct.pack("<QQ", *(_of_long(data) if len(data) >= LONG else _of_short(data)))


def _of_short(data: bytes) -> tuple[int, int]:
    """Pairs of 16 bytes, from both ends towards the middle or one after the other, stirred into two sums."""
    length = len(data)
    sums = length * PRIME64[0] & MASK, 0
    if length < MEDIUM:
        pairs = [(16 * k, length - 16 * (k + 1), 32 * k) for k in reversed(range((length - 1) // 32 + 1))]
    else:
        for at in range(0, 128, 32):
            sums = _stirred(sums, data, at, at + 16, at)
        sums = _avalanche(sums[0]), _avalanche(sums[1])
        pairs = [(at, at + 16, at - 128 + 3) for at in range(128, length - 31, 32)]
        pairs.append((length - 16, length - 32, 103))
    for first, second, secret in pairs:
        sums = _stirred(sums, data, first, second, secret)
    low, high = sums
    mixed = low * PRIME64[0] + high * PRIME64[3] + length * PRIME64[1]
    return _avalanche((low + high) & MASK), -_avalanche(mixed & MASK) & MASK


def _of_long(data: bytes) -> tuple[int, int]:
    """Eight sums over stripes of 64 bytes, and over the last 64."""
    sums = [PRIME32[2], *PRIME64[:4], PRIME32[1], PRIME64[4], PRIME32[0]]
    stripes = [(STRIPE * k, 8 * k) for k in range((len(data) - 1) // STRIPE)]
    for at, secret in (*stripes, (len(data) - STRIPE, len(SECRET) - STRIPE - 7)):
        for lane in range(8):
            value = _word(data, at + 8 * lane)
            keyed = value ^ _word(SECRET, secret + 8 * lane)
            sums[lane ^ 1] = (sums[lane ^ 1] + value) & MASK
            sums[lane] = (sums[lane] + (keyed & 0xFFFFFFFF) * (keyed >> 32)) & MASK
    low, high = len(data) * PRIME64[0], ~(len(data) * PRIME64[1])
    return _merged(sums, 11, low & MASK), _merged(sums, len(SECRET) - STRIPE - 11, high & MASK)


def _merged(sums: list[int], secret: int, start: int) -> int:
    parts = (
        _folded(sums[k] ^ _word(SECRET, secret + 8 * k), sums[k + 1] ^ _word(SECRET, secret + 8 * k + 8))
        for k in range(0, 8, 2)
    )
    return _avalanche(reduce(int.__add__, parts, start) & MASK)


def _stirred(sums: tuple[int, int], data: bytes, first: int, second: int, secret: int) -> tuple[int, int]:
    """The 16 bytes at `first` and those at `second` into both sums."""
    low, high = sums
    low = (low + _keyed(data, first, secret)) ^ (_word(data, second) + _word(data, second + 8) & MASK)
    high = (high + _keyed(data, second, secret + 16)) ^ (_word(data, first) + _word(data, first + 8) & MASK)
    return low & MASK, high & MASK


def _keyed(data: bytes, at: int, secret: int) -> int:
    return _folded(_word(data, at) ^ _word(SECRET, secret), _word(data, at + 8) ^ _word(SECRET, secret + 8))


def _folded(left: int, right: int) -> int:
    """Both halves of the product of 128 bits, one over the other."""
    product = left * right
    return (product & MASK) ^ (product >> 64)


def _avalanche(value: int) -> int:
    value = (value ^ (value >> 37)) * 0x165667919E3779F9 & MASK
    return value ^ (value >> 32)


def _word(data: bytes, at: int) -> int:
    return int.from_bytes(data[at : at + 8], "little")
