"""What a step costs on any machine, however loaded: the calls that Python makes in it."""

import sys
from collections.abc import Callable


def calls_in(step: Callable[[], object]) -> int:
    """Calls of functions, of Python's or of C's, while the step runs for the second time: the first loads modules."""
    step()
    count = 0

    def counted(_frame: object, event: str, _argument: object) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(counted)
    try:
        step()
    finally:
        sys.setprofile(before)
    return count
