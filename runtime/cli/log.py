"""Commands on the black box: log info, log verify, log recover, mark."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from runtime.cli.output import answer, say, say_json
from runtime.cli.progress import AsJson, busy

Run = Annotated[Path, typer.Argument(metavar="RUN", help="folder of a run", show_default=False)]


def info(run: Run, as_json: AsJson = False) -> None:
    """Show the header, segments and marks of a run, and what was removed from it."""
    from runtime.record.check import run_info

    facts = run_info(run)
    answer(facts, _info_lines(facts), as_json)


def _info_lines(facts: dict[str, Any]) -> list[str]:
    lines = [
        f"run       {facts['run']}  {facts['source']}  {facts['created_utc']}  {facts['bytes'] / 1e6:.1f} MB",
        f"version   infant {facts['versions'].get('infant', 'unknown')}",
        f"manifest  {facts['manifest']}",
    ]
    start_s = min((each["from_s"] for each in facts["segments"] if each["from_s"] is not None), default=0.0)
    for segment in facts["segments"]:
        from_s, to_s = segment["from_s"], segment["to_s"]
        span = "" if from_s is None else f"  {from_s - start_s:.1f} to {to_s - start_s:.1f} s"
        ticks = "" if segment["ticks"] is None else f"  {segment['ticks']} ticks"
        marked = "  marked" if segment["marked"] else ""
        size = f"{segment['bytes'] / 1e6:.2f} MB"
        lines.append(f"segment   {segment['name']}  {segment['state']}  {size}{ticks}{span}{marked}")
    lines += [f"gone      {name}: {reason}" for name, reason in facts["gone"].items()]
    return lines + [f"mark      {reason}" for reason in facts["marks"]]


def verify(run: Run, as_json: AsJson = False) -> None:
    """Read and check every byte of a run.

    Exit code 6: something differs from what was written, or the run was cut off.
    """
    from runtime.errors import StorageError
    from runtime.record.check import verify_run

    with busy("read"):
        found = verify_run(run)
    error = None
    if found.damages:
        error = StorageError(
            f"{run} differs from what was written ({len(found.damages)} finding(s)); infant log recover "
            "writes what is intact into a new run"
        )
    lines = [f"gap       {sentence}" for sentence in found.gaps]
    lines += [f"damage    {sentence}" for sentence in found.damages]
    lines.append(f"read      {found.ticks} ticks in {found.segments} segment(s), {len(found.gaps)} gap(s)")
    if not found.damages and not found.gaps:
        lines.append("intact    every byte is as it was written")
    answer({"run": str(run), "whole": not found.damages} | asdict(found), lines, as_json, error)
    if error is not None:
        raise error


def recover(
    run: Run,
    out: Annotated[Path, typer.Option("--out", help="folder of the new run; created, never overwritten")],
    as_json: AsJson = False,
) -> None:
    """Write everything that is intact into a new run; the damaged one is left as it is."""
    from runtime.record.check import recover_run
    from runtime.record.folder import RunFolder

    RunFolder.open(run)
    folder = RunFolder.create(out, out.parent)
    with busy("recover"), folder.whole_or_gone():
        result = recover_run(run, folder)
    lines = [f"lost      {sentence}" for sentence in result["losses"]]
    answer(result, [*lines, f"run       {result['out']}  {result['ticks']} ticks"], as_json)


def mark(
    reason: Annotated[str, typer.Argument(metavar="REASON", help="what you saw, in one sentence", show_default=False)],
    run: Annotated[
        Path | None, typer.Option("--run", help="folder of a run; default: the one that is being recorded")
    ] = None,
    runs: Annotated[Path, typer.Option("--runs", help="folder that holds the runs (record.folder)")] = Path("runs"),
    as_json: AsJson = False,
) -> None:
    """Keep the minutes around this moment, however full the disk gets; a finished run is kept as a whole."""
    from runtime.record.folder import RunFolder
    from runtime.record.marks import leave_mark, running_run

    folder = RunFolder.open(run) if run is not None else running_run(runs)
    taken = leave_mark(folder, reason)
    if as_json:
        say_json({"run": str(folder.path), "reason": reason, "taken": taken})
    else:
        waits = "" if taken else "  (the recorder has not answered yet; the mark is queued)"
        say(f"marked    {folder.path}{waits}")


COMMANDS = (mark,)
LOG_COMMANDS = (info, verify, recover)
LOG_HELP = "Show what a recorded run holds, verify it, and recover a damaged one."
