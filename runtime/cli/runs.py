"""Commands on a recorded run: replay, import, evaluate, smooth, review, compare, view, export."""

import os
import sys
from contextlib import nullcontext
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.begin_in import BeginIn, LocaliseOnly, StartAt
from runtime.cli.live import Set, stop_on_signals
from runtime.cli.output import answer, say, say_json
from runtime.cli.progress import LONGEST_S, AsJson, busy, progress_bar
from runtime.errors import InfantError, StorageError, UsageError


class FailOn(StrEnum):
    """Least severity that makes a review fail."""

    INFO = "info"
    WARN = "warn"
    ERROR = "error"


Run = Annotated[Path, typer.Argument(metavar="RUN", help="folder of a run")]
AllowDefects = Annotated[
    bool, typer.Option("--allow-defects", help="do not exit with code 70 if steps of the filter raised an error")
]


def replay(
    run: Run,
    config: Annotated[Path | None, typer.Option("--config", help="another configuration than the recorded one")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="folder for the replayed run; never overwritten")] = None,
    verify: Annotated[bool, typer.Option("--verify", help="compare with the record, bit for bit")] = False,
    seed: Annotated[int | None, typer.Option("--seed", help="use another seed for the filter")] = None,
    set_: Set = None,
    without: Annotated[
        list[str] | None,
        typer.Option("--without", metavar="TECHNIQUE", help="switch off a technique of the paper: difference, ..."),
    ] = None,
    map_: BeginIn = None,
    localise_only: LocaliseOnly = False,
    start_at: StartAt = None,
    allow_defects: AllowDefects = False,
    as_json: AsJson = False,
) -> None:
    """Run the filter over a recorded run again, as fast as possible."""
    from runtime.map_files import start
    from runtime.replay.replay import replay_lines, replay_run

    begin = start.BeginIn(map_, localise_only, start_at)
    overrides = replay_overrides(set_, without, seed)
    result = replay_run(run, config, out, verify, overrides, progress_bar("replay"), begin)
    altered, error = "; ".join(result["altered"][:3]), None
    if altered:
        error = StorageError(f"{run} is not as it was when it was closed ({altered}); see infant log verify")
    answer(result, replay_lines(result), as_json, error)
    _end_with_defects(result["defects"], allow_defects)
    if error is not None:
        raise error
    if verify and not (result["identical"] or result["within_tolerance"]):
        sys.exit(1)


def _end_with_defects(defects: int, allowed: bool) -> None:
    """A run some of whose steps were none is not what it was asked for."""
    if defects and not allowed:
        sys.exit(InfantError.exit_code)


def replay_overrides(set_: list[str] | None, without: list[str] | None, seed: int | None) -> dict[str, str]:
    """The three ways to change a replay's configuration as one mapping."""
    from runtime.settings import overrides

    changes = overrides.key_values(set_ or []) | overrides.without(without or [])
    if seed is not None:
        changes["seed"] = str(seed)
    return changes


def import_(
    source: Annotated[Path, typer.Argument(metavar="SOURCE", help="a recording: arrays, ROS bag, CARMEN log, ...")],
    out: Annotated[Path, typer.Option("--out", metavar="RUN", help="folder of the new run; never overwritten")],
    config: Annotated[Path | None, typer.Option("--config", help="default: the data set's own file in config/")] = None,
    at_rest: Annotated[bool, typer.Option("--at-rest", help="the sensor stood still; needs no odometry")] = False,
    scan_topic: Annotated[str | None, typer.Option("--scan-topic", help="if a bag has several of LaserScan")] = None,
    odom_topic: Annotated[str | None, typer.Option("--odom-topic", help="if a bag has several of Odometry")] = None,
    as_json: AsJson = False,
) -> None:
    """Convert a recording from another system into a run that can be replayed and evaluated."""
    from runtime.importers.data_set import import_data_set, import_lines
    from runtime.importers.rosbag import Topics

    with busy("import"):
        result = import_data_set(source, out, config, at_rest, Topics(scan_topic, odom_topic))
    answer(result, import_lines(result), as_json)


def evaluate(
    run: Run,
    truth: Annotated[
        Path | None,
        typer.Option("--truth", help="TUM file, in the time of the run or UTC; default: the truth in the run"),
    ] = None,
    allow_defects: AllowDefects = False,
    as_json: AsJson = False,
) -> None:
    """Compare a run with its ground truth; write trajectory.tum, odometry.tum and truth.tum for evo."""
    from runtime.evaluate import evaluate as evaluation

    with busy("evaluate"):
        result = evaluation.evaluate(run, truth)
    answer(result, evaluation.evaluation_lines(result), as_json)
    _end_with_defects(result["defects"], allow_defects)


def smooth(run: Run, as_json: AsJson = False) -> None:
    """Smooth path and landmarks with everything that a run saw, and find matches that contradict it; needs gtsam."""
    from runtime.smooth.smooth import smooth_lines, smooth_run

    result = smooth_run(run, progress_bar("replay"))
    answer(result, smooth_lines(result), as_json)


def review(
    run: Run,
    fail_on: Annotated[
        FailOn | None,
        typer.Option("--fail-on", help="exit with code 1 if there is a finding of this severity or above, for CI"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.html", help="file to write; default: in the run")
    ] = None,
    allow_defects: AllowDefects = False,
    as_json: AsJson = False,
) -> None:
    """Write report.html and report.json with findings, and draw review.rrd again."""
    from runtime.atomic_write import beside
    from runtime.record.reader import RunReader
    from runtime.record.room import is_being_written
    from runtime.record.trajectories import with_estimates
    from runtime.review.rebuild import drawn_meanwhile

    folder = with_estimates(RunReader(run)).folder
    drawn = folder.review_path if out is None else beside(out, ".rrd")
    recording = is_being_written(folder.mcap_path)  # whoever records a run draws it too
    with busy("judge and draw"), nullcontext() if recording else drawn_meanwhile(folder.path, drawn) as finish:
        from runtime.report.build import build_report, is_as_grave, report_lines  # 0.5 s, while the other one begins

        report = build_report(run, out)
        if finish is not None:
            finish(report["verdict"])
    report["review"] = str(drawn)
    answer(report, [*report_lines(report), f"review    {drawn}"], as_json)
    _end_with_defects(report["defects"]["steps"], allow_defects)
    if fail_on is not None and is_as_grave(report, fail_on.value):
        sys.exit(1)


def compare(
    first: Annotated[Path, typer.Argument(metavar="RUN", help="folder of a run")],
    second: Annotated[Path, typer.Argument(metavar="OTHER", help="folder of another run, or of a replay of it")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.html", help="default: compare.html in the second run")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare two runs side by side: figures, findings and differences in their configurations."""
    from runtime.report.compare import build_comparison, comparison_lines

    with busy("compare"):
        result = build_comparison(first, second, out)
    answer(result, comparison_lines(result), as_json)


def view(
    run: Annotated[
        str | None, typer.Argument(metavar="RUN", help="folder of a run; with --live, host or endpoint of the rover")
    ] = None,
    web: Annotated[bool, typer.Option("--web", help="open a browser instead of the native viewer")] = False,
    screenshot: Annotated[
        Path | None, typer.Option("--screenshot", metavar="FILE.png", help="write a picture; no screen needed")
    ] = None,
    at: Annotated[
        float | None, typer.Option("--at", min=0.0, max=LONGEST_S, help="start at this second of the run")
    ] = None,
    live: Annotated[bool, typer.Option("--live", help="show a running rover, over zenoh")] = False,
    connect: Annotated[
        str | None, typer.Option("--connect", metavar="ENDPOINT|HOST", help="for a live rover; default: this machine")
    ] = None,
    rover: Annotated[
        str | None, typer.Option("--rover", help="name of a live rover; default: the only one that answers")
    ] = None,
    zenoh_file: Annotated[
        Path | None, typer.Option("--zenoh", help="zenoh configuration with the certificate for the router of a fleet")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Open the recording of a run, or a running rover, in the rerun viewer; served on this machine only."""
    from runtime.review import viewer

    if live:
        _view_live(run or connect, rover, zenoh_file, web, screenshot, as_json)
        return
    if run is None:
        raise UsageError("no run given; give the folder of a run, or --live for a running rover")
    if connect is not None or rover is not None:
        raise UsageError("--connect and --rover apply to a live rover; add --live")
    from runtime.record.folder import RunFolder

    folder = RunFolder.open(Path(run))
    progress = progress_bar("draw")
    if screenshot is None:
        if web and at is not None:
            raise UsageError("--at works in the native viewer only; leave out --web, or move the time in the browser")
        code = viewer.open_review(folder, web, progress, at, lambda line: say(f"infant: {line}", err=True))
        if as_json:
            say_json({"run": run, "viewer_exit_code": code})
        return
    reports = viewer.screenshot(folder, screenshot, at, progress=progress)
    shown = {"run": run, "picture": str(screenshot), "viewer_reports": reports}
    answer(shown, (f"picture   {screenshot}",), as_json)
    for report in () if as_json else reports:
        say(f"infant: the viewer reports: {report}", err=True)


def _view_live(
    connect: str | None, rover: str | None, zenoh_file: Path | None, web: bool, screenshot: Path | None, as_json: bool
) -> None:
    from runtime.optional_packages import needs

    if screenshot is not None:
        raise UsageError("--screenshot works for a recorded run; leave out --live")
    os.environ.setdefault("RUST_LOG", "off")  # rerun calls it an error that the viewer is closed while it is drawn into
    with needs("rerun", "infant view --live"):
        from runtime.live_view.view import view_live
    file = None if zenoh_file is None else str(zenoh_file)
    code = view_live(connect, rover, file, web, stop_on_signals(), lambda line: say(f"infant: {line}", err=True))
    if as_json:
        say_json({"rover": rover, "viewer_exit_code": code})


def calibrate(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN", help="folders of recorded drives")],
    config: Annotated[Path | None, typer.Option("--config", help="start from the values in this file")] = None,
    write: Annotated[
        Path | None,
        typer.Option(
            "--write", metavar="FILE", help="configuration to write; comments stay, and FILE.before is what was there"
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find wheel geometry, laser mount, latency and noise from ordinary drives, with 95 % intervals."""
    from runtime.calibrate.recorded_drives import calibrate_runs
    from runtime.calibrate.result import calibration_lines
    from runtime.calibrate.write import backup_of, text_to_write_into, write_configuration
    from runtime.settings.configuration import load_configuration

    into = None if write is None else text_to_write_into(write, config)
    with busy("calibrate"):
        result, believed = calibrate_runs(runs, None if config is None else load_configuration(config))
    changed = write_configuration(result, believed.text, write, into) if write is not None else ()
    if as_json:
        written = None if write is None else str(write)
        say_json(result.as_json() | {"written": written, "changed": list(changed)})
        return
    say(*calibration_lines(result))
    if write is not None:
        say(f"written   {write} ({', '.join(changed) or 'nothing changed'})")
        if changed and (kept := backup_of(write.resolve())).exists():
            say(f"kept      {kept}, the file as it was before")


def export(
    run: Run,
    ros2: Annotated[
        Path | None, typer.Option("--ros2", metavar="DIR", help="rosbag2 folder for ROS 2, Foxglove and Lichtblick")
    ] = None,
    csv: Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="one line per tick")] = None,
    tum: Annotated[Path | None, typer.Option("--tum", metavar="FILE", help="the path, for evo")] = None,
    geojson: Annotated[
        Path | None, typer.Option("--geojson", metavar="FILE", help="path and landmarks, in metres of the map frame")
    ] = None,
    resolution: Annotated[float, typer.Option(min=0.02, max=10.0, help="cell size of the grid on /map, m")] = 0.1,
    grid: Annotated[bool, typer.Option("--grid/--no-grid", help="whether the bag gets an occupancy grid")] = True,
    as_json: AsJson = False,
) -> None:
    """Export a run to the formats of other programs, with stamps in UTC; nothing is overwritten."""
    from runtime.export.export import Outputs, export_lines, export_run

    outputs = Outputs(ros2, csv, tum, geojson)
    result = export_run(run, outputs, progress_bar("export"), resolution if grid else None)
    answer(result, export_lines(result), as_json)


COMMANDS = (replay, import_, evaluate, smooth, calibrate, review, compare, view, export)
