"""Where the files that come with the program lie: the one place that knows the shape of the source tree."""

from collections.abc import Iterator
from pathlib import Path

from slam.kernel_cache import hash_of_files

ROOT = Path(__file__).resolve().parents[1]
SHIPPED = Path(__file__).resolve().with_name("shipped")  # links to the folders at the root; an installation has copies
CONFIG = (SHIPPED / "config").resolve()
SYSTEMD = (SHIPPED / "systemd").resolve()
SHARED_DATA = ROOT.parent / "shared" / "data"


def shipped_configuration(path: Path) -> Path:
    """The shipped configuration that a bare name such as `mock` or `examples/steered` means, else the path as it is."""
    named = CONFIG / f"{path}.toml"
    bare = not path.suffix and not path.is_absolute() and ".." not in path.parts
    return named if bare and not path.exists() and named.is_file() else path


def shipped_names() -> list[str]:
    """Bare names of all shipped configurations."""
    return sorted(str(path.relative_to(CONFIG).with_suffix("")) for path in CONFIG.rglob("*.toml"))


def sources_of(*packages: str) -> Iterator[Path]:
    """Every Python file of these packages, each named as it is imported."""
    for package in packages:
        place = ROOT.joinpath(*package.split("."))
        yield from place.rglob("*.py") if place.is_dir() else (place.with_suffix(".py"),)


def code_hash(*packages: str, configurations: bool = False) -> str:
    """Names the state of the sources of these packages, and of the shipped configurations where they count."""
    files = [*sources_of(*packages), *(CONFIG.glob("*.toml") if configurations else ())]
    return hash_of_files(ROOT, files)
