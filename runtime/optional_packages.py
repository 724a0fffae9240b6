"""Packages that only some commands need: where one is absent, the command says in one sentence what to install."""

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
