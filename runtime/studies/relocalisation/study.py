"""Kidnaps, second sessions, slips and localisation only as jobs; what came out as tables."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime.errors import UsageError
from runtime.source_tree import code_hash
from runtime.studies.files import Row, write_json, write_rows, write_text
from runtime.studies.jobs import Job, Result, run_jobs
from runtime.studies.relocalisation.kidnaps import kidnap_trial, world_trial
from runtime.studies.relocalisation.localisation import localise_trial
from runtime.studies.relocalisation.sessions import session_trial
from runtime.studies.relocalisation.slips import slip_trial
from runtime.studies.relocalisation.strangers import stranger_trial
from slam.recognise.attempt import LEAST_MATCHES
from slam.recognise.confirmation import NEW_MATCHES

PARTS = ("worlds", "recordings", "sessions", "strangers", "localise", "slips")
KIDNAPPED_IN = {"victoria_park": 100, "intel_lab": 60}  # recordings, and how often
MAPPED_SHARE = 0.6
WORLDS = (("P", 0.0), ("V2", 0.0), ("P", 0.3), ("P", 0.5))
PLACES_A_WORLD = 5  # twenty seeds make 100
SESSIONS = ("wean_hall_1", "wean_hall_3", "wean_hall_4")
STRANGERS = ("intel_lab", "fr079_a", "belgioioso", "seattle", "aces_austin", "fr101", "edmonton", "minesparis_exp1")
SLIPPED_IN, SLIPS = "victoria_park", 32
MOST_LOCALISED = 8  # seeds
RIGHT_M = 5.0
ENOUGH = LEAST_MATCHES + NEW_MATCHES  # landmarks of a map, without which no place in it is announced
NEVER_M = 1e9


def run_relocalisation(
    parts: Sequence[str],
    seeds: int,
    data: Path,
    folder: Path,
    scheduler: str | None,
    progress: Callable[[int, int], None],
) -> dict[str, Any]:
    """Run what is missing, write relocalisation.md and .json and a CSV for each part, return what --json prints.

    Raises StorageError, DataSetError, and UsageError for a part that is none.
    """
    for part in parts:
        if part not in PARTS:
            raise UsageError(f"{part}: expected {', '.join(PARTS)}")
    code = code_hash("slam", "runtime.studies.relocalisation", "runtime.studies.paper.drives")
    jobs = {part: jobs_of(part, seeds, str(data), code) for part in parts}
    results = run_jobs([job for part in jobs.values() for job in part], folder / "jobs", scheduler, progress)
    lines: list[str] = []
    outcome: dict[str, Any] = {"out": str(folder), "seeds": seeds}
    for part, of_part in jobs.items():
        own, results = results[: len(of_part)], results[len(of_part) :]
        rows = rows_of(part, own)
        write_rows(folder / f"{part}.csv", rows)
        outcome[part] = rows
        lines += [*table(rows), ""]
    write_text(folder / "relocalisation.md", lines)
    write_json(folder / "relocalisation.json", outcome)
    return outcome | {"lines": lines}


def jobs_of(part: str, seeds: int, data: str, code: str) -> list[Job]:
    """What a part consists of."""
    each = range(seeds)
    match part:
        case "worlds":
            told = [{"kind": kind, "exchanged": share, "seed": seed} for kind, share in WORLDS for seed in each]
            return [Job(world_trial, {**one, "count": PLACES_A_WORLD, "code": code}) for one in told]
        case "recordings":
            told = [{"name": name, "count": count} for name, count in KIDNAPPED_IN.items()]
            return [Job(kidnap_trial, {"data": data, "share": MAPPED_SHARE, "seed": 1, "code": code} | x) for x in told]
        case "sessions":
            told = [{"mapped": one, "driven": other} for one in SESSIONS for other in SESSIONS if one != other]
            return [Job(session_trial, {"data": data, "code": code, **one}) for one in told]
        case "strangers":
            told = [{"driven": one, "maps": list(STRANGERS)} for one in STRANGERS]
            return [Job(stranger_trial, {"data": data, "code": code, **one}) for one in told]
        case "localise":
            some = range(min(seeds, MOST_LOCALISED))
            told = [{"kind": kind, "seed": seed} for kind in ("P", "V2") for seed in some]
            return [Job(localise_trial, {"code": code, **one}) for one in told]
    slips = (None, *range(min(SLIPS, 2 * seeds)))
    return [Job(slip_trial, {"data": data, "name": SLIPPED_IN, "seed": seed, "code": code}) for seed in slips]


def rows_of(part: str, results: Sequence[Result]) -> list[Row]:
    """A row for each place, pair, world or slip."""
    if part in ("worlds", "recordings"):
        names = dict.fromkeys(result["name"] for result in results)
        return [kidnap_row(name, [result for result in results if result["name"] == name]) for name in names]
    if part == "localise":
        return [localise_row(kind, [one for one in results if one["kind"] == kind]) for kind in ("P", "V2")]
    return [dict(result) for result in results]


def kidnap_row(name: str, results: Sequence[Result]) -> Row:
    """Recognised of those in the map, how far they had driven (of all of these), and how many were wrong anywhere. The
    same of those that pass as many of its landmarks as the two attempts ask for.
    """
    everyone = [kidnap for result in results for kidnap in result["kidnaps"]]
    inside = [kidnap for kidnap in everyone if kidnap["in_map"]]
    passing = [kidnap for kidnap in inside if kidnap["passes"] >= ENOUGH]
    ways, of_passing = (
        np.sort([NEVER_M if kidnap["driven_m"] is None else kidnap["driven_m"] for kidnap in some])
        for some in (inside, passing)
    )
    found = [kidnap for kidnap in everyone if kidnap["driven_m"] is not None]
    errors = np.array([kidnap["error_m"] for kidnap in found])
    return {
        "name": name,
        "landmarks": round(float(np.mean([result["landmarks"] for result in results]))),
        "kidnaps": len(everyone),
        "in the map": len(inside),
        "recognised": sum(kidnap["driven_m"] is not None for kidnap in inside),
        "within 5 m": int((ways <= RIGHT_M).sum()),
        "within 20 m": int((ways <= 4.0 * RIGHT_M).sum()),
        "50 %, m": _quantile(ways, 0.5),
        "90 %, m": _quantile(ways, 0.9),
        f"passing {ENOUGH}": len(passing),
        "of these": int((of_passing < NEVER_M).sum()),
        "of these 50 %, m": _quantile(of_passing, 0.5),
        "of these 90 %, m": _quantile(of_passing, 0.9),
        "error 50 %, m": round(float(np.median(errors)), 3) if len(errors) else None,
        f"wrong by {RIGHT_M:g} m": int((errors > RIGHT_M).sum()),
    }


def localise_row(kind: str, results: Sequence[Result]) -> Row:
    """All worlds of a kind."""
    return {
        "world": kind,
        "drives": len(results),
        "rms_m": round(float(np.mean([one["rms_m"] for one in results])), 3),
        "worst_rms_m": max(one["rms_m"] for one in results),
        "nees_median": round(float(np.median([one["nees_median"] for one in results])), 2),
        "map_moved_m": max(one["moved_m"] for one in results),
        "gone": sum(one["gone"] for one in results),
    }


def table(rows: Sequence[Row]) -> list[str]:
    """For people."""
    if not rows:
        return []
    names = list(rows[0])
    return [
        f"| {' | '.join(names)} |",
        "|" + "---|" * len(names),
        *(f"| {' | '.join('-' if row[name] is None else str(row[name]) for name in names)} |" for row in rows),
    ]


def _quantile(ways_m: np.ndarray, share: float) -> float | None:
    """None where it was never reached."""
    if not len(ways_m):
        return None
    way_m = float(np.quantile(ways_m, share, method="higher"))
    return None if way_m >= NEVER_M else round(way_m, 1)
