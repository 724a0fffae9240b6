"""The paper's figures and table as jobs, and their results as tables with intervals."""

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.compile_cache import sources_hash
from runtime.paper.arms import NORMAL, PROPOSED, ablation_arms
from runtime.paper.feature_drive import feature_drive
from runtime.paper.jobs import Job, Result, run_jobs
from runtime.paper.outdoor_drive import outdoor_drive
from runtime.paper.spread import compare, spread
from runtime.paper.victoria import data_folder, victoria_drive

FloatArray = NDArray[np.float64]
Row = dict[str, Any]

PARTS = ("fig1", "fig2", "table1", "ablation", "fig5", "fig6")
OUTDOOR, PRINTED, VICTORIA = "outdoor (simulated)", "outdoor (simulated), printed front end", "Victoria Park"
OUTDOOR_S = 60.0
JOB_SOURCES = (
    *("arms", "feature_vote", "feature_drive", "outcome", "outdoor", "outdoor_drive"),
    *("trajectory_error", "victoria", "walkers", "worlds"),
)


@dataclass(frozen=True, slots=True)
class Cell:
    """One arm in one world, over all seeds."""

    world: str
    arm: str


@dataclass(frozen=True, slots=True)
class Study:
    """What is asked for. particles: of every arm. paths are kept for the first seed."""

    parts: tuple[str, ...]
    seeds: int
    particles: int
    duration_s: float = OUTDOOR_S
    steps: int | None = None

    def cells(self) -> list[Cell]:
        """Every arm and world that the parts need, each once."""
        wanted: list[Cell] = []
        feature_worlds = ("P", "V2")
        if {"fig1", "fig2", "table1"} & set(self.parts):
            wanted += [Cell(world, arm) for world in feature_worlds for arm in (PROPOSED, NORMAL)]
        if "ablation" in self.parts:
            wanted += [Cell("V2", arm) for arm in (PROPOSED, NORMAL, *ablation_arms())]
        if "fig5" in self.parts:
            wanted += [Cell(world, PROPOSED) for world in (OUTDOOR, PRINTED)]
        if "fig6" in self.parts:
            worlds = (*feature_worlds, OUTDOOR, *((VICTORIA,) if data_folder() is not None else ()))
            wanted += [Cell(world, arm) for world in worlds for arm in (PROPOSED, "ekf", "motion")]
        return list(dict.fromkeys(wanted))

    def job(self, cell: Cell, seed: int) -> Job:
        """One seed of one cell."""
        common: dict[str, Any] = {"seed": seed, "arm": cell.arm, "particles": self.particles, "code": code_hash()}
        common["keep_paths"] = seed == 0
        if cell.world == VICTORIA:
            return Job(victoria_drive, common)
        if cell.world in (OUTDOOR, PRINTED):
            front_end = "paper" if cell.world == PRINTED else "robust"
            return Job(outdoor_drive, {**common, "duration_s": self.duration_s, "front_end": front_end})
        return Job(feature_drive, {**common, "kind": cell.world, "steps": self.steps})


Outcomes = Mapping[Cell, list[Result]]


def run_study(study: Study, folder: Path, scheduler: str | None, progress: Callable[[int, int], None]) -> Outcomes:
    """Results of every cell, in the order of seeds. Finished jobs in folder/jobs are not run again."""
    cells = study.cells()
    order = [(cell, seed) for seed in range(study.seeds) for cell in cells]
    results = run_jobs([study.job(cell, seed) for cell, seed in order], folder / "jobs", scheduler, progress)
    outcomes: dict[Cell, list[Result]] = {cell: [] for cell in cells}
    for (cell, _), result in zip(order, results, strict=True):
        outcomes[cell].append(result)
    return outcomes


def spread_rows(outcomes: Outcomes) -> list[Row]:
    """Every quantity of every cell with its spread over seeds."""
    rows = []
    for cell, results in outcomes.items():
        for name in quantities(results):
            figures = spread(column(results, name)).row()
            rows.append({"world": cell.world, "arm": cell.arm, "quantity": name, **figures})
    return rows


def comparison_rows(outcomes: Outcomes, against: Iterable[str] = (PROPOSED, NORMAL)) -> list[Row]:
    """Every arm against the proposed one, and the proposed one against normal, paired by seed.

    The published pose is compared with the particles of normal estimation as well: that publishes nothing else.
    """
    rows = []
    for base in against:
        for cell, results in outcomes.items():
            other = outcomes.get(Cell(cell.world, base))
            if other is None or cell.arm == base or (base == NORMAL and cell.arm != PROPOSED):
                continue
            for name in quantities(results):
                instead = name.replace("published", "particles") if base == NORMAL else name
                if instead not in quantities(other):
                    continue
                figures = compare(column(results, name), column(other, instead)).row()
                rows.append({"world": cell.world, "arm": cell.arm, "against": base, "quantity": name, **figures})
    return rows


def quantities(results: list[Result]) -> list[str]:
    """Names of the numbers that every seed has."""
    return [
        name
        for name in results[0]
        if all(isinstance(result.get(name), int | float) for result in results)
    ]


def column(results: list[Result], name: str) -> FloatArray:
    """One number per seed, (n,)."""
    return np.array([float(result[name]) for result in results])


def code_hash() -> str:
    """Names the state of the method, the simulation and this study: a change makes every job a new one."""
    root = Path(__file__).parents[2]
    sources = [*sorted((root / "drivers" / "simulated").glob("*.py")), root / "config" / "victoria_park.toml"]
    sources += [Path(__file__).with_name(f"{name}.py") for name in JOB_SOURCES]
    digest = hashlib.sha256(sources_hash().encode())
    for path in sources:
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]
