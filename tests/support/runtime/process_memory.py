"""What a process and its children hold in memory."""

from pathlib import Path


def held_mb(pid: int) -> float:
    """Memory of a process and its children, what they share counted once; 0 of what has ended."""
    try:
        rollup = Path(f"/proc/{pid}/smaps_rollup").read_text().split()
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return 0.0
    return int(rollup[rollup.index("Pss:") + 1]) * 1024e-6 + sum(held_mb(int(child)) for child in children)
