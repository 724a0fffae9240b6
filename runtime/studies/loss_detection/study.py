"""Kidnapped, blinded and undisturbed drives over many seeds: how often a loss is detected, and false alarms."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from runtime.source_tree import code_hash
from runtime.studies.files import Row, write_rows
from runtime.studies.jobs import Job, Result, run_jobs
from runtime.studies.loss_detection.drives import BLINDED, KIDNAPPED, MishapKind
from runtime.studies.loss_detection.picture import CurvePoint, draw
from runtime.studies.loss_detection.trial import PLACES, judged_again, trial
from slam.estimate import Quality
from slam.settings.quality import QualitySettings

Progress = Callable[[int, int], None]

CALIBRATION_SEED, EVALUATION_SEED = 10_000, 20_000  # the bounds were chosen on the first, the figures are of the second
WITHIN_S = 3.0
DRIVE_S = 600.0
MUST_SHARE, MUST_PER_HOUR = 0.95, 1.0
TRULY_LOST_M, TRULY_LOST_RAD = 0.5, 0.1  # a pose that is this wrong is lost indeed, whatever happened to it
BACK_M, BACK_RAD, BACK_WITHIN_S = 0.1, 0.05, 4.0  # a kidnapped rover is back on the right pose
SCORES = (1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0, 60.0, 100.0, 200.0, 400.0)
BLIND_S = (0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 2.5, 2.9, 3.5)
EXTRA_KINDS = (MishapKind.FROZEN,)


@dataclass(frozen=True, slots=True)
class StudySize:
    """runs: drives of either sort of mishap; hours: of undisturbed driving among people."""

    runs: int
    hours: float
    particles: int
    first_seed: int = EVALUATION_SEED


def code_name() -> str:
    """Names the state of the method, the simulated world and the drives: a change makes every job a new one."""
    return code_hash(
        "slam", "drivers.simulated", "runtime.studies.loss_detection.drives", "runtime.studies.loss_detection.trial"
    )


def study_jobs(size: StudySize, code: str) -> list[Job]:
    """Every drive of the study; places and kinds take turns."""
    places, jobs = list(PLACES), []

    def add(seed: int, turn: int, kind: str) -> None:
        arguments = {
            "seed": seed,
            "where": places[turn % len(places)],
            "kind": kind,
            "duration_s": DRIVE_S,
            "particles": size.particles,
            "quality": {},
            "code": code,
        }
        jobs.append(Job(trial, arguments))

    for group, kinds in enumerate((KIDNAPPED, BLINDED)):
        for run in range(size.runs):
            add(size.first_seed + 1000 * group + run, run, kinds[(run // len(places)) % len(kinds)].value)
    for run in range(math.ceil(size.runs / 10)):
        add(size.first_seed + 2000 + run, run, EXTRA_KINDS[0].value)
    for run in range(round(size.hours * 3600.0 / DRIVE_S)):
        add(size.first_seed + 3000 + run, run, "")
    return jobs


def study(size: StudySize, folder: Path, code: str, scheduler: str | None, progress: Progress) -> dict[str, Any]:
    """Run what is missing, and give the figures, the curve and every drive's outcome; writes CSV and PNG."""
    results = run_jobs(study_jobs(size, code), folder / "jobs", scheduler, progress)
    outcome = summarise(results)
    points = curve(results)
    rows = [point_row(point) for point in points]
    write_rows(folder / "curve.csv", rows)
    write_rows(folder / "drives.csv", drive_rows(results))
    draw(points, folder / "curve.png")
    return outcome | {"curve": str(folder / "curve.png"), "points": rows}


def summarise(results: Sequence[Result]) -> dict[str, Any]:
    """Share detected by kind and by group, false alarms, and drives that were truly lost without a mishap."""
    defaults = QualitySettings()
    delays: dict[str, list[float | None]] = {}
    for result in results:
        if result["kind"]:
            delays.setdefault(result["kind"], []).append(noticed_after_s(result, defaults))
    false, true = alarms(results, defaults)
    hours = driven_h(results)
    return {
        "kinds": {kind: kind_figures(found) for kind, found in delays.items()},
        "kidnapped": kind_figures([delay for kind in KIDNAPPED for delay in delays.get(kind.value, [])]),
        "blinded": kind_figures([delay for kind in BLINDED for delay in delays.get(kind.value, [])]),
        "found_back": back_figures([found_back_s(result) for result in results if result["kind"] in KIDNAPPED]),
        "hours": round(hours, 2),
        "false_alarms": false,
        "false_per_hour": round(false / hours, 3) if hours else None,
        "true_losses": true,
    }


def kind_figures(delays: Sequence[float | None]) -> dict[str, Any]:
    """Drives, share detected within 3 s, median and largest delay of those that were detected."""
    known = sorted(delay for delay in delays if delay is not None)
    return {
        "runs": len(delays),
        "told_share": round(sum(delay <= WITHIN_S for delay in known) / len(delays), 3) if delays else None,
        "delay_p50_s": round(float(np.median(known)), 2) if known else None,
        "delay_max_s": round(known[-1], 2) if known else None,
    }


def detected_after_s(result: Result, settings: QualitySettings) -> float | None:
    """From the mishap to the first tick that says lost; None if none does."""
    trace = np.array(result["trace"])
    for row, quality in zip(trace, judged_again(trace, settings), strict=True):
        if row[0] >= result["at_s"] and quality is Quality.LOST:
            return float(row[0] - result["at_s"])
    return None


def noticed_after_s(result: Result, settings: QualitySettings) -> float | None:
    """From the mishap until the pose says lost, or is right: one that is put down nearby may not even lose its way."""
    after_s = [detected_after_s(result, settings), found_back_s(result) if result["kind"] in KIDNAPPED else None]
    return min((delay for delay in after_s if delay is not None), default=None)


def found_back_s(result: Result) -> float | None:
    """From the mishap to the tick from which on the pose is right; None where it is not at the end."""
    trace = np.array(result["trace"])
    after = trace[trace[:, 0] >= result["at_s"]]
    wrong = np.flatnonzero((after[:, 8] > BACK_M) | (np.abs(after[:, 9]) > BACK_RAD))
    if len(wrong) == 0:
        return 0.0
    return None if wrong[-1] == len(after) - 1 else float(after[wrong[-1] + 1, 0] - result["at_s"])


def back_figures(delays: Sequence[float | None]) -> dict[str, Any]:
    """Share of the kidnapped that were back within BACK_WITHIN_S, and how soon those were that came back."""
    known = sorted(delay for delay in delays if delay is not None)
    return {
        "back_share": round(sum(delay <= BACK_WITHIN_S for delay in known) / len(delays), 3) if delays else None,
        "back_p50_s": round(float(np.median(known)), 2) if known else None,
        "back_p99_s": round(float(np.quantile(known, 0.99)), 2) if known else None,
    }


def alarms(results: Sequence[Result], settings: QualitySettings) -> tuple[int, int]:
    """How often an undisturbed drive says lost: while the pose is right, and while it is truly wrong."""
    false = true = 0
    for result in results:
        trace = np.array(result["trace"])
        before, wrong = Quality.TRACKING, False
        for row, quality in zip(trace, judged_again(trace, settings), strict=True):
            if result["kind"] and row[0] >= result["at_s"]:
                break
            wrong = bool(row[8] > TRULY_LOST_M or abs(row[9]) > TRULY_LOST_RAD)
            if quality is Quality.LOST and before is not Quality.LOST:
                false, true = false + (not wrong), true + wrong
            before = quality
    return false, true


def driven_h(results: Sequence[Result]) -> float:
    """Hours of driving before anything happened."""
    seconds: float = sum(r["at_s"] if r["kind"] else r["trace"][-1][0] for r in results)
    return seconds / 3600.0


def curve(results: Sequence[Result]) -> list[CurvePoint]:
    """Either bound swept while the other stays: the score for kidnapped drives, the blind time for blinded ones."""
    hours, points = max(driven_h(results), 1e-9), []
    for bound, values, kinds in (("lost_score", SCORES, KIDNAPPED), ("lost_blind_s", BLIND_S, BLINDED)):
        mishaps = [result for result in results if result["kind"] in kinds]
        for value in values:
            settings = QualitySettings.model_validate({bound: value})
            delays = [detected_after_s(result, settings) for result in mishaps]
            detected = sum(delay is not None and delay <= WITHIN_S for delay in delays) / max(len(delays), 1)
            points.append(CurvePoint(bound, value, detected, alarms(results, settings)[0] / hours))
    return points


def drive_rows(results: Sequence[Result]) -> list[Row]:
    """One row a drive."""
    return [
        {
            **{name: result[name] for name in ("seed", "where", "kind", "at_s")},
            "back_after_s": found_back_s(result) if result["kind"] else None,
            "told_after_s": detected_after_s(result, QualitySettings()) if result["kind"] else None,
            "largest_error_m": max(tick[8] for tick in result["trace"]),
            "changes": len(result["states"]) - 1,
        }
        for result in results
    ]


def point_row(point: CurvePoint) -> Row:
    """For CSV and JSON."""
    return {
        "bound": point.bound,
        "value": point.value,
        "told_share": round(point.detected_share, 4),
        "false_per_hour": round(point.false_per_hour, 4),
    }


def study_lines(outcome: dict[str, Any]) -> list[str]:
    """For a person, each figure beside what it must be."""
    lines = [f"{'':18s} {'drives':>7s} {'found in 3 s':>12s} {'median':>8s} {'slowest':>8s}"]
    for name, row in (("kidnapped", outcome["kidnapped"]), ("blinded", outcome["blinded"]), *outcome["kinds"].items()):
        if row["runs"]:
            delays = (f"{row[key]:.2f} s" if row[key] is not None else "-" for key in ("delay_p50_s", "delay_max_s"))
            figures = " ".join(f"{delay:>8s}" for delay in delays)
            lines.append(f"{name:18s} {row['runs']:7d} {row['told_share']:12.0%} {figures}")
    back = outcome["found_back"]
    if back["back_p50_s"] is not None:
        lines.append(
            f"found back         {back['back_share']:.0%} of the kidnapped within {BACK_WITHIN_S:g} s to {BACK_M:g} m; "
            f"median {back['back_p50_s']:.2f} s, 99 % {back['back_p99_s']:.2f} s"
        )
    per_hour = outcome["false_per_hour"]
    detected = min(outcome[sort]["told_share"] or 0.0 for sort in ("kidnapped", "blinded"))
    lines.append(
        f"false alarms       {outcome['false_alarms']} in {outcome['hours']} h"
        + (f" ({per_hour:g} an hour)" if per_hour is not None else "")
        + f"; truly lost without a mishap: {outcome['true_losses']}"
    )
    met = detected >= MUST_SHARE and per_hour is not None and per_hour < MUST_PER_HOUR
    verdict = "ok" if met else "NOT MET"
    lines.append(f"must               {MUST_SHARE:.0%} detected, fewer than {MUST_PER_HOUR:g} an hour: {verdict}")
    lines.append(f"curve              {outcome['curve']}")
    return lines
