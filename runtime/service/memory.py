"""What a process holds of the machine's memory."""

import os
from pathlib import Path


def resident_mb(pid: int | None = None) -> float:
    """Memory that a process holds, this one by default, in units of 10^6 bytes; 0 when it has ended."""
    try:
        pages = int(Path(f"/proc/{pid or os.getpid()}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") * 1e-6
