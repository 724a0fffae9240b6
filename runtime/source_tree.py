"""Where the files that come with the program lie: the one place that knows the shape of the source tree."""

from collections.abc import Iterator
from pathlib import Path

from slam.kernel_cache import hash_of_files

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / "config"
SHARED_DATA = ROOT.parent / "shared" / "data"


def sources_of(*packages: str) -> Iterator[Path]:
    """Every Python file of these packages, each named as it is imported."""
    for package in packages:
        place = ROOT.joinpath(*package.split("."))
        yield from place.rglob("*.py") if place.is_dir() else (place.with_suffix(".py"),)


def code_hash(*packages: str, configurations: bool = False) -> str:
    """Names the state of the sources of these packages, and of the shipped configurations where they count."""
    files = [*sources_of(*packages), *(CONFIG.glob("*.toml") if configurations else ())]
    return hash_of_files(ROOT, files)
