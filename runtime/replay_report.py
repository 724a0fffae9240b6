"""A replay's summary for a person."""

from typing import Any


def replay_lines(summary: dict[str, Any]) -> list[str]:
    """A handful of lines."""
    step = summary["step_ms"]
    lines = [
        f"ticks     {summary['ticks']} with {summary['scans']} scans, {summary['recording_s']:.1f} s of recording",
        f"time      {summary['elapsed_s']:.1f} s, {summary['times_real_time']} times real time; "
        f"step p50 {step['p50']:.2f}  p99 {step['p99']:.2f}  max {step['max']:.2f} ms",
        f"landmarks {summary['landmarks']}",
    ]
    if summary["identical"] is not None:
        same = f"identical to the record, every bit of {summary['compared']} estimates and state hashes"
        lines.append(f"verify    {same if summary['identical'] else 'DIFFERS: ' + summary['difference']}")
    if summary["truncated"] is not None:
        lines.append(f"note      {summary['truncated']}")
    if summary["out"] is not None:
        lines.append(f"estimates {summary['out']}")
    return lines
