"""Packages that only some commands need: where one is absent, the command says in one sentence what to install."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from runtime.errors import UsageError

HOW_TO_INSTALL = {
    "rerun": "pip install rerun-sdk, or drive without a picture: review.live = false",
    "gtsam": "pip install 'infant[smooth]'",
    "matplotlib": "pip install 'infant[review]'",
    "foxglove": "pip install 'infant[foxglove]'",
    "starlette": "pip install 'infant[page]'",
    "uvicorn": "pip install 'infant[page]'",
    "cyclonedds": "pip install 'infant[ros2]' on x86-64 with Python up to 3.13, or use infant bridge rclpy",
}


@contextmanager
def needs(package: str, what: str) -> Iterator[None]:
    """Import inside what `what` needs. Raises UsageError where the package is absent."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != package:
            raise
        raise UsageError(
            f"{what} needs the package {package}, which is not installed: {HOW_TO_INSTALL[package]}"
        ) from error


class _Absent:
    """A finder of modules that says of one package that it is not there."""

    def __init__(self, package: str) -> None:
        self._package = package

    def find_spec(self, name: str, *_: object) -> None:
        """As the import system asks. Raises ModuleNotFoundError."""
        if name == self._package:
            raise ModuleNotFoundError(f"{name} is left out of this process", name=name)


def leave_out(package: str) -> None:
    """Let this process have none of a package that another loads where it is found, and does without where not.

    pyarrow does so with pandas: 44 MB and 0.3 s of a process that only draws.
    """
    sys.meta_path.insert(0, _Absent(package))
