"""The paper's figures and table as jobs, and their results as tables with intervals."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drivers.measurements import FloatArray
from runtime.source_tree import code_hash
from runtime.studies.files import Row
from runtime.studies.jobs import Job, Result, run_jobs
from runtime.studies.paper.drives.arms import NORMAL, PROPOSALS, PROPOSED, RANGE_GATED, ablation_arms
from runtime.studies.paper.drives.blind_step import blind_step
from runtime.studies.paper.drives.feature_drive import feature_drive
from runtime.studies.paper.drives.outdoor_drive import outdoor_drive
from runtime.studies.paper.drives.recorded_drive import CODED, INDOOR, VICTORIA, is_there, recorded_drive
from runtime.studies.paper.spread import compare, spread

PARTS = ("published", "fig1", "fig2", "table1", "ablation", "fig5", "fig6")
FEATURE_WORLDS = ("P", "V2")
OUTDOOR, PRINTED = "outdoor (simulated)", "outdoor (simulated), printed front end"
BLIND, WITHHELD = "blind step", "identities withheld"
OUTDOOR_S = 60.0
VICTORIA_PARTICLES = (10, 100)
LEFT_OUT = 0.05
NORMAL_SEEDS = 6  # minutes each: enough for its counts and times; its errors are those of the gated form, on all seeds
JOB_SOURCES = (
    "slam",
    "drivers.simulated",
    "runtime.studies.paper.drives",
    "runtime.evaluate.errors",
    "runtime.evaluate.against_truth",
    "runtime.evaluate.rows",
)
"""What a finished job depends on besides the configurations: a change makes every job a new one."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One arm in one world, over all seeds.

    particles: None for those of the study. left_out: share of what was seen that each seed leaves out at random.
    most_seeds: None for those of the study; the published pose of a recording is the same for every seed.
    """

    world: str
    arm: str
    particles: int | None = None
    left_out: float = 0.0
    most_seeds: int | None = None


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
        if {"published", "fig1", "fig2", "table1"} & set(self.parts):
            wanted += [Cell(world, arm) for world in FEATURE_WORLDS for arm in (PROPOSED, NORMAL)]
        if "published" in self.parts:
            wanted += published_cells()
        if "ablation" in self.parts:
            wanted += [Cell("V2", arm) for arm in (PROPOSED, *ablation_arms())]
        if "fig5" in self.parts:
            wanted += [Cell(world, PROPOSED) for world in (OUTDOOR, PRINTED)]
        if "fig6" in self.parts:
            wanted += [Cell(world, arm) for world in (*FEATURE_WORLDS, "LONELY", OUTDOOR, BLIND) for arm in PROPOSALS]
            if is_there(VICTORIA):
                wanted += [Cell(VICTORIA, arm, VICTORIA_PARTICLES[0]) for arm in (PROPOSED, "ekf")]
        return list(dict.fromkeys(wanted))

    def job(self, cell: Cell, seed: int) -> Job:
        """One seed of one cell."""
        particles = self.particles if cell.particles is None else cell.particles
        common: dict[str, Any] = {
            "seed": seed,
            "arm": cell.arm,
            "particles": particles,
            "code": code_hash(*JOB_SOURCES, configurations=True),
        }
        if cell.world == BLIND:
            return Job(blind_step, common)
        common["keep_paths"] = seed == 0
        name, _, withheld = cell.world.partition(", ")
        if name in (VICTORIA, INDOOR, *CODED):
            recording = {"data_set": name, "withheld": bool(withheld), "left_out": cell.left_out}
            return Job(recorded_drive, {**common, **recording})
        if cell.world in (OUTDOOR, PRINTED):
            front_end = "paper" if cell.world == PRINTED else "robust"
            return Job(outdoor_drive, {**common, "duration_s": self.duration_s, "front_end": front_end})
        return Job(feature_drive, {**common, "kind": cell.world, "steps": self.steps})


def published_cells() -> list[Cell]:
    """What the figures of the published pose need beyond P and V2 with the study's particles.

    RANGE_GATED is normal estimation without the likelihoods that its gate saves: the same comparison with more
    particles at a fiftieth of the time.
    """
    cells = [
        Cell(world, arm, particles)
        for world in FEATURE_WORLDS
        for arm, particles in ((PROPOSED, 30), (PROPOSED, 100), (RANGE_GATED, 30))
    ]
    cells.append(Cell("LONELY", PROPOSED))
    if is_there(VICTORIA):
        cells += [Cell(VICTORIA, PROPOSED, particles) for particles in VICTORIA_PARTICLES]
        cells.append(Cell(VICTORIA, PROPOSED, VICTORIA_PARTICLES[0], LEFT_OUT))
    for world in [f"{name}{told}" for name in CODED if is_there(name) for told in ("", f", {WITHHELD}")]:
        cells += [Cell(world, PROPOSED, most_seeds=1), Cell(world, PROPOSED, left_out=LEFT_OUT)]
    if is_there(INDOOR):
        cells += [Cell(INDOOR, PROPOSED, most_seeds=1), Cell(INDOOR, PROPOSED, left_out=LEFT_OUT)]
    return cells


Outcomes = Mapping[Cell, list[Result]]


def run_study(study: Study, folder: Path, scheduler: str | None, progress: Callable[[int, int], None]) -> Outcomes:
    """Results of every cell, in the order of seeds. Finished jobs in folder/jobs are not run again."""
    cells = study.cells()
    order = [(cell, seed) for seed in range(study.seeds) for cell in cells if seed < seeds_of(cell, study.seeds)]
    results = run_jobs([study.job(cell, seed) for cell, seed in order], folder / "jobs", scheduler, progress)
    outcomes: dict[Cell, list[Result]] = {cell: [] for cell in cells}
    for (cell, _), result in zip(order, results, strict=True):
        outcomes[cell].append(result)
    return outcomes


def seeds_of(cell: Cell, seeds: int) -> int:
    """How many of the study's seeds a cell runs."""
    most = NORMAL_SEEDS if cell.arm == NORMAL else cell.most_seeds
    return seeds if most is None else min(seeds, most)


def spread_rows(outcomes: Outcomes) -> list[Row]:
    """Every quantity of every cell with its spread over seeds."""
    rows = []
    for cell, results in outcomes.items():
        for name in quantities(results):
            figures = spread(column(results, name)).row()
            rows.append({**label(cell), "quantity": name, **figures})
    return rows


def label(cell: Cell) -> Row:
    """The columns that say which cell a row is of; particles are empty where they are the study's."""
    return {"world": cell.world, "arm": cell.arm, "particles": cell.particles or "", "left_out": cell.left_out}


def comparison_rows(outcomes: Outcomes, against: Iterable[str] = (PROPOSED, NORMAL, RANGE_GATED)) -> list[Row]:
    """Every arm against the proposed one, and the proposed one against normal (gated or not), paired by seed.

    The published pose is compared with the particles of normal estimation as well: that publishes nothing else. An arm
    with fewer seeds is compared on those that it has.
    """
    rows = []
    for base in against:
        for cell, results in outcomes.items():
            other = outcomes.get(replace(cell, arm=base))
            if other is None or cell.arm == base or (base != PROPOSED and cell.arm != PROPOSED):
                continue
            for name in quantities(results):
                instead = name.replace("published", "particles") if base != PROPOSED else name
                if instead not in quantities(other):
                    continue
                both = min(len(results), len(other))
                figures = compare(column(results, name)[:both], column(other, instead)[:both]).row()
                rows.append({**label(cell), "against": base, "quantity": name, **figures})
    return rows


def quantities(results: list[Result]) -> list[str]:
    """Names of the numbers that every seed has."""
    return [name for name in results[0] if all(isinstance(result.get(name), int | float) for result in results)]


def column(results: list[Result], name: str) -> FloatArray:
    """One number per seed, (n,)."""
    return np.array([float(result[name]) for result in results])
