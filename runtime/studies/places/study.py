"""Every public recording, the simulated building and beams that drop out, as jobs; their results as tables."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runtime.errors import UsageError
from runtime.source_tree import code_hash
from runtime.studies.files import Row, write_json, write_rows, write_text
from runtime.studies.jobs import Job, run_jobs
from runtime.studies.paper.spread import spread
from runtime.studies.places.at_rest import place_at_rest
from runtime.studies.places.building_drive import building_drive
from runtime.studies.places.drop_outs import CORRIDOR, PARK, SHARES, drop_out_drive
from runtime.studies.places.outcomes import (
    AT_REST,
    BUILDINGS,
    DEFAULTS,
    DROPPED,
    OWN,
    SIMULATED,
    Key,
    Outcome,
    Outcomes,
    dropped,
)
from runtime.studies.places.page import page_lines
from runtime.studies.places.recorded_place import recorded_place
from runtime.studies.places.recordings import archive_of, recordings, stands_still
from runtime.studies.places.targets import asked_rows

LEFT_OUT = 0.05
JOB_SOURCES = (
    "slam",
    "drivers.simulated",
    "runtime.evaluate",
    "runtime.importers",
    "runtime.studies.loss_detection.drives",
    "runtime.studies.paper.drives.recorded_drive",
    *(
        f"runtime.studies.places.{name}"
        for name in ("at_rest", "building_drive", "drive", "drop_outs", "figures", "recorded_place", "recordings")
    ),
)
"""What a finished job depends on besides the configurations and the archives: a change makes every job a new one."""


@dataclass(frozen=True, slots=True)
class PlacesStudy:
    """data: the folder of the recordings. places: None for all. length: share of the simulated drives."""

    data: Path
    repeats: int
    places: tuple[str, ...] | None = None
    length: float = 1.0

    @property
    def seeds(self) -> int:
        """Of a simulated place, which has no drive but those."""
        return max(1, self.repeats)

    def chosen(self) -> list[str]:
        """Recordings first. Raises UsageError for a name that is none."""
        known = [*recordings(self.data), *BUILDINGS, DROPPED]
        if self.places is None:
            return known
        if unknown := [name for name in self.places if name not in known]:
            raise UsageError(f"{', '.join(unknown)}: not in {self.data}; there are {', '.join(known)}")
        return list(dict.fromkeys(self.places))


def run_places(
    study: PlacesStudy, folder: Path, scheduler: str | None, progress: Callable[[int, int], None]
) -> dict[str, Any]:
    """Run what is missing, write places.csv, asked.csv, places.json and places.md, and return what --json prints.

    Raises UsageError, DataSetError, ConfigurationError, StorageError.
    """
    jobs = [job for place in study.chosen() for job in _jobs(study, place)]
    results = run_jobs([job for _, _, job in jobs], folder / "jobs", scheduler, progress)
    outcomes: dict[Key, Outcome] = {}
    for (key, whole, _), result in zip(jobs, results, strict=True):
        outcome = outcomes.setdefault(key, Outcome())
        if whole:
            outcome.whole = result
        else:
            outcome.repeats.append(result)
    figures, asked = figure_rows(outcomes), asked_rows(outcomes)
    lines = page_lines(outcomes, asked, study.repeats)
    write_rows(folder / "places.csv", figures)
    write_rows(folder / "asked.csv", asked)
    write_text(folder / "places.md", lines)
    result = {
        "out": str(folder),
        "repeats": study.repeats,
        "places": study.chosen(),
        "asked": asked,
        "figures": figures,
    }
    write_json(folder / "places.json", result)
    return {**result, "lines": lines}


def figure_rows(outcomes: Outcomes) -> list[Row]:
    """Every figure of every place: with everything seen, and its spread over the repeats."""
    rows = []
    for (place, way), outcome in outcomes.items():
        for name in outcome.results[0]:
            repeated = outcome.repeated(name)
            whole = "" if outcome.whole is None else outcome.whole.get(name, "")
            figures = spread(repeated).row() if len(repeated) else {}
            rows.append(
                {"place": place, "way": way, "figure": name, "whole": whole, "repeats": len(repeated), **figures}
            )
    return rows


def _jobs(study: PlacesStudy, place: str) -> list[tuple[Key, bool, Job]]:
    code = code_hash(*JOB_SOURCES, configurations=True)
    if place in BUILDINGS:
        rate_hz, beams = BUILDINGS[place]
        common: dict[str, Any] = {"rate_hz": rate_hz, "beam_count": beams, "slam": {}, "code": code}
        common["laps"] = 1.1 * study.length
        return [
            ((place, SIMULATED), False, Job(building_drive, {**common, "seed": seed})) for seed in range(study.seeds)
        ]
    if place == DROPPED:
        return [
            ((where, dropped(share)), False, Job(drop_out_drive, arguments))
            for where in (PARK, CORRIDOR)
            for share in (0.0, *SHARES)
            for seed in range(study.seeds)
            for arguments in ({"where": where, "share": share, "seed": seed, "code": code, "length": study.length},)
        ]
    archive = archive_of(study.data, place)
    digest = hashlib.sha256(archive.path.read_bytes()).hexdigest()[:16]
    common = {"data": str(study.data), "name": place, "code": code, "digest": digest}
    draws = [(True, {"left_out": 0.0, "seed": 0})]
    draws += [(False, {"left_out": LEFT_OUT, "seed": seed}) for seed in range(study.repeats)]
    if stands_still(archive):
        return [((place, AT_REST), whole, Job(place_at_rest, {**common, **draw})) for whole, draw in draws]
    return [
        ((place, OWN if own else DEFAULTS), whole, Job(recorded_place, {**common, **draw, "own": own}))
        for own in (True, False)
        for whole, draw in draws
    ]


def study_lines(result: Mapping[str, Any]) -> Sequence[str]:
    """For people: the page, and where it lies."""
    return [*result["lines"], f"Tables, places.md and places.json: {result['out']}"]
