"""Commands over many seeds: paper, sweep."""

import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from runtime.cli.live import Set
from runtime.cli.output import answer, say, say_json
from runtime.cli.progress import AsJson, progress_bar
from runtime.errors import UsageError
from runtime.source_tree import SHARED_DATA

if TYPE_CHECKING:
    from runtime.studies.bench.figure import BenchFigure

Scheduler = Annotated[str, typer.Option("--scheduler", help="address of a dask scheduler, local (all cores), or none")]


class Part(StrEnum):
    """What of the paper; the published pose and the places are this project's own additions to it."""

    PUBLISHED = "published"
    FIG1 = "fig1"
    FIG2 = "fig2"
    TABLE1 = "table1"
    ABLATION = "ablation"
    FIG5 = "fig5"
    FIG6 = "fig6"
    PLACES = "places"
    RECOGNITION = "recognition"
    RELOCALISATION = "relocalisation"
    ALL = "all"


def paper(
    part: Annotated[
        Part,
        typer.Argument(
            metavar="PART",
            help="what to reproduce: one figure, the table, the ablation, the published pose, or all of these; "
            "or one of three studies: places, recognition, relocalisation",
        ),
    ],
    more: Annotated[
        list[str] | None, typer.Argument(metavar="SET", help="places and relocalisation: only these sets")
    ] = None,
    seeds: Annotated[int, typer.Option("--seeds", min=1, max=1000, help="drives for each variant")] = 20,
    out: Annotated[Path, typer.Option("--out", help="folder for pictures and tables; finished jobs are kept")] = Path(
        "paper"
    ),
    particles: Annotated[int, typer.Option("--particles", min=1, max=10_000, help="particles in every variant")] = 30,
    repeats: Annotated[
        int, typer.Option("--repeats", min=0, max=1000, help="places: repeats, each leaving out 5 % of the scans")
    ] = 20,
    sets: Annotated[list[str] | None, typer.Option("--sets", metavar="SET", help="places: only these")] = None,
    data: Annotated[
        Path,
        typer.Option(
            "--data",
            envvar="INFANT_DATA",
            help="folder of the public recordings",
            show_default="shared/data next to the source tree",
        ),
    ] = SHARED_DATA,
    scheduler: Scheduler = "local",
    as_json: AsJson = False,
) -> None:
    """Reproduce the paper's figures with their spread over seeds, and say which claims hold.

    "places" drives through every public recording, with its own configuration file and with the defaults, through a
    simulated building, and with beams that drop out. "recognition" looks for places in generated maps, and for places
    that are in none; 20 seeds make 30 000 of these. "relocalisation" puts rovers down in maps of earlier drives:
    worlds, recordings, sessions, strangers, localise, slips.
    """
    chosen = [*(sets or []), *(more or [])]
    if part is Part.PLACES:
        from runtime.studies.places import study as places

        study = places.PlacesStudy(data, repeats, tuple(chosen) or None)
        outcome = places.run_places(study, out, chosen_scheduler(scheduler), job_progress("places"))
        answer(outcome, places.study_lines(outcome), as_json)
        return
    if part is Part.RECOGNITION and not chosen:
        from runtime.studies.recognition import study as recognition

        outcome = recognition.run_recognition(seeds, out, chosen_scheduler(scheduler), job_progress("recognition"))
        answer(outcome, outcome["lines"], as_json)
        return
    if part is Part.RELOCALISATION:
        from runtime.studies.relocalisation import study as relocalisation

        parts = tuple(chosen) or relocalisation.PARTS
        show = job_progress("relocalisation")
        outcome = relocalisation.run_relocalisation(parts, seeds, data, out, chosen_scheduler(scheduler), show)
        answer(outcome, outcome["lines"], as_json)
        return
    if chosen:
        raise UsageError(
            f"{' '.join(chosen)}: only places and relocalisation take sets; leave them out of infant paper {part.value}"
        )
    from runtime.optional_packages import needs

    with needs("matplotlib", "infant paper"):
        from runtime.studies.paper.reproduce import reproduce, study_lines
        from runtime.studies.paper.study import PARTS, Study

    parts = PARTS if part is Part.ALL else (part.value,)
    result = reproduce(Study(parts, seeds, particles), out, chosen_scheduler(scheduler), job_progress("paper"))
    answer(result, study_lines(result), as_json)


def sweep(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN", help="folders of recorded runs")],
    out: Annotated[Path, typer.Option("--out", help="folder for the table; finished jobs are kept")],
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=V1,V2", help="values of one key of the configuration")
    ] = None,
    seeds: Annotated[int, typer.Option("--seeds", min=1, max=1000, help="seeds of the filter, counted from 1")] = 5,
    scheduler: Scheduler = "local",
    as_json: AsJson = False,
) -> None:
    """Replay recorded runs with every combination of settings and seeds; write one table as Parquet and CSV."""
    from runtime.studies import parameter_sweep as sweeping

    result = sweeping.sweep(runs, set_ or [], seeds, out, chosen_scheduler(scheduler), job_progress("sweep"))
    answer(result, [f"{result['rows']} rows: {result['csv']}, {result['parquet']}"], as_json)


def chosen_scheduler(word: str) -> str | None:
    """What run_jobs takes. Raises UsageError on an empty word."""
    if not word:
        raise UsageError("--scheduler: expected an address such as tcp://10.0.0.1:8786, local, or none")
    return None if word == "none" else word


def job_progress(task: str) -> Callable[[int, int], None]:
    """A bar for jobs done of all."""
    show = progress_bar(task)
    return lambda done, total: show(done / max(total, 1))


def quality(
    runs: Annotated[int, typer.Option(min=1, max=10_000, help="number of kidnapped drives, and of blinded ones")] = 100,
    hours: Annotated[float, typer.Option(min=0.2, max=1000.0, help="hours of undisturbed driving among people")] = 3.0,
    particles: Annotated[int, typer.Option("--particles", min=1, max=10_000, help="particles of the filter")] = 100,
    calibration: Annotated[
        bool,
        typer.Option(
            "--calibration", help="use the drives on which the thresholds were chosen, not those that judge them"
        ),
    ] = False,
    out: Annotated[Path, typer.Option("--out", help="folder for the curve; finished drives are kept")] = Path(
        "quality"
    ),
    scheduler: Scheduler = "none",
    as_json: AsJson = False,
) -> None:
    """Measure how often a kidnapped or blinded rover says that it is lost, and how often it says so wrongly."""
    from runtime.studies.loss_detection import study as studies
    from slam.estimator import Estimator

    Estimator.warm_up()
    first_seed = studies.CALIBRATION_SEED if calibration else studies.EVALUATION_SEED
    size = studies.StudySize(runs, hours, particles, first_seed)
    outcome = studies.study(size, out, studies.code_name(), chosen_scheduler(scheduler), job_progress("quality"))
    answer(outcome, studies.study_lines(outcome), as_json)


def rate(
    config: Annotated[Path, typer.Option("--config", help="configuration to run")] = Path("mock"),
    minutes: Annotated[float, typer.Option(min=0.05, max=1440.0, help="minutes to run")] = 10.0,
    hogs: Annotated[int, typer.Option(min=0, max=64, help="busy processes to run at the same time")] = 2,
    fsync: Annotated[bool, typer.Option("--fsync/--no-fsync", help="also run a loop of fsync on the same disk")] = True,
    privileges: Annotated[
        bool, typer.Option("--privileges/--no-privileges", help="use real-time priority and locked memory")
    ] = True,
    set_: Set = None,
    as_json: AsJson = False,
) -> None:
    """Run while other processes keep the computer busy; print how well the loop kept its rate and what each stage
    took.
    """
    from runtime.studies.rate import measure_rate, rate_lines

    measured = measure_rate(config, minutes, hogs, fsync, privileges, set_ or [])
    answer(measured, rate_lines(measured), as_json)


def soak(
    config: Annotated[Path, typer.Option("--config", help="configuration to run; of a simulated rover")] = Path("mock"),
    minutes: Annotated[
        float, typer.Option(min=0.01, max=1440.0, help="minutes it takes if the computer keeps up")
    ] = 30.0,
    speed: Annotated[float, typer.Option(min=0.5, max=100.0, help="times faster than real time, at most")] = 10.0,
    out: Annotated[
        Path | None, typer.Option("--out", help="folder in which to keep the run; default: it is not kept")
    ] = None,
    set_: Set = None,
    as_json: AsJson = False,
) -> None:
    """Simulate hours of driving with a clock that skips sleep; print memory growth, file
    descriptors left open, and missed cycles of the loop.
    """
    from runtime.cli.live import stop_on_signals
    from runtime.studies.soak.soak import soak as drive_long
    from runtime.studies.soak.soak import soak_lines

    stop = stop_on_signals()
    with tempfile.TemporaryDirectory(prefix="infant-soak-", dir=Path.cwd()) as name:
        measured = drive_long(config, minutes, speed, out or Path(name), set_ or [], stop, sys.stderr)
    answer(measured, soak_lines(measured), as_json)


def bench(
    run: Annotated[
        Path | None,
        typer.Argument(
            metavar="RUN", help="measure what review and export of this run cost instead", show_default=False
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Measure the speed of the filter on this machine in CPU time; takes two to three minutes. With RUN, the time and
    the memory that review and export of that run take.
    """
    results = []
    for measure in bench_figures(run):
        results.append(asdict(measure))
        if not as_json:
            p99 = f"  p99 {measure.p99:g}" if measure.p99 is not None else ""
            say(f"{measure.name:42s} {measure.value:10g} {measure.unit}{p99}")
    if as_json:
        say_json({"results": results})


def bench_figures(run: Path | None) -> Iterator["BenchFigure"]:
    """Those of a run, or those of the filter, which load it."""
    if run is not None:
        from runtime.studies.bench.of_a_run import measure_run

        return measure_run(run)
    from runtime.studies.bench.measures import measures

    return measures()


COMMANDS = (paper, sweep, quality, rate, soak, bench)
