"""Whether a service can run the program from where it stands: in sight under ProtectHome, PrivateTmp; readable."""

import re
import stat
import sys
from collections.abc import Iterable
from pathlib import Path

from runtime.source_tree import ROOT

HIDDEN = tuple(Path(each) for each in ("/home", "/root", "/run/user", "/tmp", "/var/tmp"))  # noqa: S108 nothing is put there
"""What ProtectHome= and PrivateTmp= of the unit take out of the service's sight."""

PLAIN = re.compile(r"[A-Za-z0-9._/+@-]+")  # all else would have to be quoted in a unit
REMEDY = "clone to /opt/infant, run 'make PYTHON=/usr/bin/python3' there, and install from that environment"


def program_path() -> Path:
    """The command `infant` of the environment that runs this."""
    return Path(sys.prefix) / "bin" / "infant"


def place_trouble(program: Path, needed: Iterable[Path], root: Path = Path("/")) -> str:
    """One sentence on why a service could not run `program`, empty if it could.

    needed: other paths that it reads, as the interpreter and the packages; root: prefix under which HIDDEN lies.
    """
    if PLAIN.fullmatch(str(program)) is None:
        return f"{program} cannot be named in a unit (only letters, digits and ._/+@- are allowed); {REMEDY}"
    for path in (program, *needed):
        if not path.exists():
            return f"{path} does not exist; {REMEDY}"
        for seen in (path.absolute(), path.resolve()):
            for hidden in HIDDEN:
                if seen.is_relative_to(root / hidden.relative_to("/")):
                    return f"{seen} is below {hidden}, which the service cannot see; {REMEDY}"
            for above in (seen, *seen.parents):
                wanted = stat.S_IROTH | (stat.S_IXOTH if above.is_dir() else 0)
                if above.is_relative_to(root) and above.stat().st_mode & wanted != wanted:
                    return f"{above} is not readable by everyone, so not by the user infant; {REMEDY}"
    return ""


def needed_paths() -> tuple[Path, ...]:
    """What the program reads besides itself: its environment, the interpreter's home, the packages."""
    return Path(sys.prefix), Path(sys.executable), Path(sys.base_prefix), ROOT / "slam"
