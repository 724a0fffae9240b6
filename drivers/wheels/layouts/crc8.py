"""CRC-8 of CAN payloads, table driven."""

from collections.abc import Callable
from functools import lru_cache


@lru_cache(maxsize=8)
def crc8_table(polynomial: int) -> bytes:
    """Remainders of all byte values, shape (256,), most significant bit first, not reflected."""
    table = bytearray(256)
    for value in range(256):
        remainder = value
        for _ in range(8):
            remainder = ((remainder << 1) ^ polynomial) & 0xFF if remainder & 0x80 else (remainder << 1) & 0xFF
        table[value] = remainder
    return bytes(table)


def crc8(polynomial: int = 0x1D, init: int = 0xFF, xor_out: int = 0xFF) -> Callable[[bytes], int]:
    """A function from bytes to their CRC-8; the defaults are SAE J1850 (check value 0x4B for b"123456789")."""
    table = crc8_table(polynomial)

    def checksum(data: bytes) -> int:
        remainder = init
        for value in data:
            remainder = table[remainder ^ value]
        return remainder ^ xor_out

    return checksum
