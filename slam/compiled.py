"""The one way in which a function of slam is compiled to machine code.

Strict IEEE arithmetic in written order (no fastmath, no threads), so that a replay repeats every bit.
The compiled code is cached on disk; the folder is chosen here, before the first kernel, whoever imports slam.
"""

import os
from collections.abc import Callable
from contextlib import suppress
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core.caching import FunctionCache

from slam.kernel_cache import use_compile_cache

cast(Any, numba.config).CACHE_DIR = str(use_compile_cache(os.environ))

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


_FunctionCache: Any = FunctionCache  # its methods have no types


class _Cache(_FunctionCache):  # type: ignore[misc]
    """A disk that is full costs the next start its time, and does not stop this one."""

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):
            super().save_overload(sig, data)


def _kept(compiled: Any, function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    compiled._cache = _Cache(function)
    return cast(Callable[Parameters, Result], compiled)


def kernel(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Compile with numba, keeping the signature visible to the type checker."""
    return _kept(numba.njit(cache=True, error_model="numpy", fastmath=False)(function), function)


def leaf(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """The same for a function that allocates no array and keeps none: arrays are only borrowed from the caller.

    numba counts references with locked instructions on entry and exit of every function, which took a third of a step;
    without its memory runtime there is nothing to count, and an allocation is refused when it is compiled.
    """
    options: dict[str, Any] = {"cache": True, "error_model": "numpy", "fastmath": False, "_nrt": False}
    return _kept(numba.njit(**options)(function), function)


def inlined(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """A leaf whose code stands in its caller: for what runs once per feature and takes many numbers as arguments."""
    options: dict[str, Any] = {"cache": True, "error_model": "numpy", "fastmath": False, "_nrt": False}
    return _kept(numba.njit(**options, forceinline=True)(function), function)
