"""Recognition in made worlds as jobs; what came out as tables."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime.source_tree import code_hash
from runtime.studies.files import Row, write_json, write_rows, write_text
from runtime.studies.jobs import Job, Result, run_jobs
from runtime.studies.recognition.trials import KINDS, cost_trial, recognition_trial

PLACES = 75  # of one world, with five null attempts each: twenty seeds make 30 000
THINGS = 196
ODDS = (7.0, 10.0, 14.0)
SIZES = {200: 40, 1000: 40, 5000: 20, 20_000: 10}  # landmarks of a map: attempts that are timed


def run_recognition(
    seeds: int, folder: Path, scheduler: str | None, progress: Callable[[int, int], None]
) -> dict[str, Any]:
    """Run what is missing, write recognition.csv, cost.csv, .md and .json, and return what --json prints.

    Raises StorageError.
    """
    code = code_hash("slam.recognise", "runtime.studies.recognition")
    jobs = [
        Job(recognition_trial, {"kind": kind, "seed": seed, "count": THINGS, "places": PLACES, "code": code})
        for kind in KINDS
        for seed in range(seeds)
    ]
    costs = [
        Job(cost_trial, {"count": count, "seed": 1, "attempts": attempts, "code": code})
        for count, attempts in SIZES.items()
    ]
    results = run_jobs([*jobs, *costs], folder / "jobs", scheduler, progress)
    trials, measured = results[: len(jobs)], results[len(jobs) :]
    rows = [kind_row(kind, [trial for trial in trials if trial["kind"] == kind]) for kind in KINDS]
    lines = page_lines(rows, measured)
    write_rows(folder / "recognition.csv", rows)
    write_rows(folder / "cost.csv", measured)
    write_text(folder / "recognition.md", lines)
    result = {"out": str(folder), "seeds": seeds, "recognition": rows, "cost": measured}
    write_json(folder / "recognition.json", result)
    return {**result, "lines": lines}


def kind_row(kind: str, trials: Sequence[Result]) -> Row:
    """All worlds of one kind."""
    odds = np.array([value for trial in trials for value in trial["null_odds"]])
    sums = {name: sum(trial[name] for trial in trials) for name in ("places", "right", "wrong", "nulls")}
    reached = {f"null_from_{bound:g}": int((odds >= bound).sum()) for bound in ODDS}
    accepted = sum(trial["null_accepted"] for trial in trials)
    largest = round(float(odds.max()), 1) if len(odds) else None
    return {"kind": kind, **sums, **reached, "null_accepted": accepted, "null_largest": largest}


def page_lines(rows: Sequence[Row], costs: Sequence[Mapping[str, Any]]) -> list[str]:
    """Two tables for people."""
    nulls, accepted = sum(row["nulls"] for row in rows), sum(row["null_accepted"] for row in rows)
    return [
        "| world | places | right | wrong | null attempts | odds from 7, 10, 14 | largest |",
        "|---|---|---|---|---|---|---|",
        *(
            f"| {row['kind']} | {row['places']} | {row['right']} | {row['wrong']} | {row['nulls']} "
            f"| {', '.join(str(row[f'null_from_{bound:g}']) for bound in ODDS)} | {row['null_largest']} |"
            for row in rows
        ),
        "",
        f"Accepted of {nulls} null attempts: {accepted}"
        + (f" (95 % bound: 1 in {nulls // 3})." if accepted == 0 else "."),
        "",
        "| landmarks | pairs | prepared | attempt with its mirror, median, 95 % | slice, 99 % |",
        "|---|---|---|---|---|",
        *(
            f"| {cost['landmarks']} | {cost['pairs']} | {cost['prepared_s']} s | {cost['attempt_ms']}, "
            f"{cost['attempt_p95_ms']} ms | {cost['slice_p99_ms']} ms |"
            for cost in costs
        ),
    ]
