"""Where the compiled kernels are kept: one folder for each state of their sources.

numba notices a change only in the file of a kernel itself, not in what that kernel calls; a cache that is shared
between versions runs old machine code. No numba may be imported before `use_compile_cache`.
"""

import hashlib
import os
import shutil
import tempfile
from collections.abc import MutableMapping
from pathlib import Path

SOURCES = Path(__file__).parents[1] / "slam"
VARIABLE = "NUMBA_CACHE_DIR"


def use_compile_cache(environment: MutableMapping[str, str]) -> Path:
    """Choose the folder, make it, and put it into the environment; one that is there already is respected.

    systemd's CACHE_DIRECTORY comes first, then XDG_CACHE_HOME, then ~/.cache; a temporary folder where none of
    these can be written.
    """
    if VARIABLE in environment:
        return Path(environment[VARIABLE])
    home = Path(environment.get("XDG_CACHE_HOME") or Path(environment.get("HOME", "/")) / ".cache") / "infant"
    base = Path(environment["CACHE_DIRECTORY"]) if "CACHE_DIRECTORY" in environment else home
    folder = base / "kernels" / sources_hash()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK)
    except OSError:
        writable = False
    if not writable:
        folder = Path(tempfile.gettempdir()) / f"infant-{os.getuid()}" / "kernels" / sources_hash()
        folder.mkdir(parents=True, exist_ok=True)
    environment[VARIABLE] = str(folder)
    return folder


def forget_other_versions(folder: Path) -> None:
    """Remove what was compiled from other sources; called when the kernels of these have just been compiled."""
    if folder.name == sources_hash() and folder.parent.name == "kernels":
        for other in folder.parent.iterdir():
            if other != folder:
                shutil.rmtree(other, ignore_errors=True)


def sources_hash() -> str:
    """Names the state of all files that kernels are made of."""
    digest = hashlib.sha256()
    for path in sorted(SOURCES.glob("*.py")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]
