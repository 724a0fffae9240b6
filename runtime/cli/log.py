"""Commands on the black box: log info, log verify, log recover, mark."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.output import say, say_json
from runtime.cli.progress import AsJson, busy

Run = Annotated[Path, typer.Argument(help="folder of a run", show_default=False)]


def info(run: Run, as_json: AsJson = False) -> None:
    """Show header, segments, marks and what is gone."""
    from runtime.record.check import run_info

    facts = run_info(run)
    if as_json:
        say_json(facts)
        return
    say(f"run       {facts['run']}  {facts['source']}  {facts['created_utc']}  {facts['bytes'] / 1e6:.1f} MB")
    say(f"manifest  {facts['manifest']}")
    for segment in facts["segments"]:
        span = "" if segment["from_s"] is None else f"  {segment['from_s']:.1f} to {segment['to_s']:.1f} s"
        ticks = "" if segment["ticks"] is None else f"  {segment['ticks']} ticks"
        marked = "  marked" if segment["marked"] else ""
        size = f"{segment['bytes'] / 1e6:.2f} MB"
        say(f"segment   {segment['name']}  {segment['state']}  {size}{ticks}{span}{marked}")
    for name, reason in facts["gone"].items():
        say(f"gone      {name}: {reason}")
    for reason in facts["marks"]:
        say(f"mark      {reason}")


def verify(run: Run, as_json: AsJson = False) -> None:
    """Read every byte of a run. Exit 6: something is not as it was written, or the run was cut off."""
    from runtime.errors import StorageError
    from runtime.record.check import verify_run

    with busy("read"):
        found = verify_run(run)
    if as_json:
        say_json({"run": str(run), "whole": not found.damages} | asdict(found))
    else:
        for kind, sentences in (("gap", found.gaps), ("damage", found.damages)):
            for sentence in sentences:
                say(f"{kind:9s} {sentence}")
        say(f"read      {found.ticks} ticks in {found.segments} segment(s), {len(found.gaps)} gap(s)")
    if found.damages:
        raise StorageError(
            f"{run} is not as it was written ({len(found.damages)} finding(s)); "
            "infant log recover writes what can be believed into a new run"
        )


def recover(
    run: Run,
    out: Annotated[Path, typer.Option("--out", help="folder of the new run; made here, never overwritten")],
    as_json: AsJson = False,
) -> None:
    """Write all that can be believed into a new run; the damaged one is not touched."""
    from runtime.record.check import recover_run
    from runtime.record.folder import RunFolder

    RunFolder.open(run)
    with busy("recover"):
        result = recover_run(run, RunFolder.create(out, out.parent))
    if as_json:
        say_json(result)
        return
    for sentence in result["losses"]:
        say(f"lost      {sentence}")
    say(f"run       {result['out']}  {result['ticks']} ticks")


def mark(
    reason: Annotated[str, typer.Argument(help="what was seen, in a sentence", show_default=False)],
    run: Annotated[Path | None, typer.Option("--run", help="folder of a run; else the one being recorded")] = None,
    runs: Annotated[Path, typer.Option("--runs", help="folder of runs to look in: record.folder")] = Path("runs"),
    as_json: AsJson = False,
) -> None:
    """Keep the segments around this moment, whatever room is needed; a run that has ended is kept as a whole."""
    from runtime.record.folder import RunFolder
    from runtime.record.marks import leave_mark, running_run

    folder = RunFolder.open(run) if run is not None else running_run(runs)
    taken = leave_mark(folder, reason)
    if as_json:
        say_json({"run": str(folder.path), "reason": reason, "taken": taken})
    else:
        waits = "" if taken else "  (the recorder has not answered yet; the mark waits)"
        say(f"marked    {folder.path}{waits}")


COMMANDS = (mark,)
LOG_COMMANDS = (info, verify, recover)
LOG_HELP = "What a recorded run holds, and whether it is what was written."
