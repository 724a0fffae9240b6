"""The one way in which a function of slam is compiled to machine code.

Strict IEEE arithmetic in written order (no fastmath, no threads), so that a replay repeats every bit.
The compiled code is cached on disk in the folder that NUMBA_CACHE_DIR names.
"""

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def kernel(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Compile with numba, keeping the signature visible to the type checker."""
    compiled = numba.njit(cache=True, error_model="numpy", fastmath=False)(function)
    return cast(Callable[Parameters, Result], compiled)
