"""Of which kind the processor is, two of which may differ in the last bit of a step, and how its libraries compute."""

import ctypes
import hashlib
import math
import os
import platform
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

import numpy as np

from runtime.printable import printable

CPU_INFO = Path("/proc/cpuinfo")
MAPS = Path("/proc/self/maps")
CORE_NAMES = tuple(f"{prefix}openblas_get_corename{suffix}" for prefix in ("scipy_", "") for suffix in ("64_", ""))
WIDE = ("sse4_2", "avx", "avx2", "fma", "avx512f", "asimd", "sve")  # instructions by which libraries choose their code
KIND = "machine"  # decides about bits: a step asks neither BLAS nor libm (decision 49)
NAMES = ("processor", "instructions", "blas", "libm")  # for people


@cache
def processor_facts() -> Mapping[str, str]:
    """Name, instructions, the BLAS core in use and the C library; the last two with a hash over what they compute."""
    info = _cpu_info()
    flags = set((info.get("flags") or info.get("Features") or "").split())
    tunables = os.environ.get("GLIBC_TUNABLES", "")
    return {
        "processor": info.get("model name") or platform.processor() or "unknown",
        "instructions": " ".join(each for each in WIDE if each in flags) or "unknown",
        "blas": f"{_blas_core()}, results {_hash_of(_linear_algebra())}",
        "libm": f"{' '.join((*platform.libc_ver(), tunables)).strip()}, results {_hash_of(_elementary())}",
    }


def other_kind(recorded: Mapping[str, str], here: Mapping[str, str]) -> str:
    """In which way the processor of a record is of another kind than this one, "" where it is not or nobody knows.

    All of one kind compute the same bits, whatever their instructions and libraries.
    """
    was, now = recorded.get(KIND, ""), here.get(KIND, "")
    return f"{KIND} {printable(was, 100)}, here {now}" if was and now and was != now else ""


def _cpu_info() -> dict[str, str]:
    """The first processor's lines."""
    try:
        first = CPU_INFO.read_text().split("\n\n")[0]
    except OSError:
        return {}
    return {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in first.splitlines())}


def _blas_core() -> str:
    """Which kernels OpenBLAS has chosen for this processor."""
    try:
        loaded = set(re.findall(r" (/.*openblas.*)$", MAPS.read_text(errors="surrogateescape"), re.MULTILINE))
    except OSError:
        loaded = set()
    for path in sorted(loaded):
        try:
            library = ctypes.CDLL(path)
        except OSError:  # replaced since it was loaded
            continue
        for name in CORE_NAMES:
            if hasattr(library, name):
                function = getattr(library, name)
                function.restype = ctypes.c_char_p
                return str(function().decode())
    return "unknown"


def _linear_algebra() -> Iterable[float]:
    """Products, inverses and factors of small matrices, as the filter has them."""
    for size in (2, 3, 5, 8, 24):
        rows = np.sin(np.arange(1.0, size * size + 1.0)).round(6).reshape(size, size)  # rounded: no matter of libm
        square = rows @ rows.T + np.eye(size)
        for result in (square, np.linalg.inv(square), np.linalg.cholesky(square), np.linalg.eigvalsh(square)):
            yield from result.ravel().tolist()


def _elementary() -> Iterable[float]:
    """Elementary functions of the C library and of numpy."""
    values = np.linspace(0.01, 30.0, 5000)  # glibc with FMA differs from glibc without in one of a thousand
    for function in (math.sin, math.cos, math.exp, math.log, math.tan):
        yield from map(function, values.tolist())
    for array in (np.sin(values), np.cos(values), np.arctan2(values, 3.0), np.exp(-values), np.log(values)):
        yield from array.tolist()


def _hash_of(values: Iterable[float]) -> str:
    return hashlib.sha256(np.array(list(values)).tobytes()).hexdigest()[:8]
