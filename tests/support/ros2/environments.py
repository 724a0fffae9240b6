"""Virtual environments with real ROS 2 from the package index, for the tests of the bridge."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from runtime.source_tree import ROOT

MESSAGES = ("geometry", "nav", "sensor", "diagnostic", "visualization")
PACKAGES = {
    "jazzy": ("ros-jazzy-rclpy[fastrtps]", *(f"ros-jazzy-{name}-msgs" for name in MESSAGES)),
    "kilted": ("ros-kilted-rclpy", "ros-kilted-rmw-fastrtps-cpp", *(f"ros-kilted-{name}-msgs" for name in MESSAGES)),
}


def python312() -> str | None:
    """A Python 3.12, for which alone these packages are made."""
    for candidate in candidates():
        asked = [candidate, "-c", "import sys, venv; print(sys.version_info[:2] == (3, 12))"]
        told = subprocess.run(asked, capture_output=True, text=True, check=False)
        if told.stdout.strip() == "True":
            return candidate
    return None


def candidates() -> Iterator[str]:
    """Where one may be."""
    yield sys.executable
    if found := shutil.which("python3.12"):
        yield found
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    yield from sorted(str(path) for path in pyenv.glob("versions/3.12.*/bin/python"))


def environment_of(distribution: str, python: str) -> tuple[Path | None, str]:
    """Its Python, made once in build/; None and why, where the index does not have the packages."""
    folder = ROOT / "build" / f"ros2-{distribution}"
    there = folder / "bin" / "python"
    if not (folder / "complete").exists():
        subprocess.run([python, "-m", "venv", "--clear", folder], check=True)
        install = [str(there), "-m", "pip", "install", "--quiet", *PACKAGES[distribution], "eclipse-zenoh>=1.10,<2"]
        done = subprocess.run(install, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            return None, done.stderr.strip().splitlines()[-1]
        (folder / "complete").touch()
    return there, ""
