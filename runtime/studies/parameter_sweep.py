"""Many settings and seeds over recorded runs, as one table."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime.atomic_write import replacement
from runtime.errors import StorageError, UsageError
from runtime.evaluate.evaluate import against_data_set, against_simulation, nothing_known
from runtime.evaluate.truth import DataSetTruth
from runtime.printable import printable
from runtime.record.reader import RunReader
from runtime.record.trajectories import Trajectories
from runtime.settings.configuration import load_configuration_text
from runtime.studies.files import Row, write_rows
from runtime.studies.jobs import Job, Result, run_jobs
from slam.estimator import Estimator
from slam.kernel_cache import sources_hash


def sweep_run(run: str, overrides: Mapping[str, str], seed: int, code: str, digest: str) -> Result:  # noqa: ARG001
    """Replay a run with other settings, keep nothing, and evaluate against the truth that the run has.

    code and digest (of the run's configuration) only name the job. Raises NotARunError, ConfigurationError.
    """
    reader = RunReader(Path(run))
    text = reader.header.configuration_text
    configuration = load_configuration_text(text, {**overrides, "seed": str(seed)}, f"configuration of {run}")
    estimator = Estimator(configuration.slam, configuration.seed)
    rows: tuple[list[tuple[float, ...]], ...] = ([], [], [])
    truth: list[tuple[float, ...]] = []
    counts: Mapping[str, float] = {}
    likelihoods = 0.0
    for recorded in reader.ticks():
        tick = recorded.tick
        estimate = estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
        seconds, counts = tick.stamp_ns * 1e-9, estimate.counts
        likelihoods += counts.get("likelihoods", 0.0)
        for column, pose in zip(
            rows, (estimate.map_from_body, estimate.particle_mean, estimate.odom_from_body), strict=True
        ):
            column.append((seconds, pose.x_m, pose.y_m, pose.heading_rad))
        if (where := recorded.truth) is not None:
            truth.append((seconds, where.x_m, where.y_m, where.heading_rad))
    estimated, particles, odometry = (np.array(column) for column in rows)
    trajectories = Trajectories(estimated, particles, odometry, np.array(truth) if truth else None)
    figures = nothing_known()
    if truth:
        figures |= against_simulation(trajectories)
    elif (held := DataSetTruth.from_attachments(reader.attachments)) is not None:
        mount = configuration.slam.mount
        figures |= against_data_set(trajectories, held, (mount.x_m, mount.y_m, mount.yaw_rad))
    return {**figures, "landmarks": counts.get("landmarks"), "likelihoods": likelihoods}


def settings_grid(words: Sequence[str]) -> list[dict[str, str]]:
    """Every combination of KEY=V1,V2 words. Raises UsageError on a word of another form."""
    keys, choices = [], []
    for word in words:
        key, equals, values = word.partition("=")
        if not key or not equals or not all(value.strip() for value in values.split(",")):
            raise UsageError(f"--set {word}: expected KEY=V1,V2, for example --set slam.particles=30,100")
        keys.append(key.strip())
        choices.append([value.strip() for value in values.split(",")])
    if len(set(keys)) != len(keys):
        raise UsageError(f"--set names a key twice: {', '.join(keys)}; give all its values in one --set")
    return [dict(zip(keys, combination, strict=True)) for combination in itertools.product(*choices)]


def sweep(
    runs: Sequence[Path],
    words: Sequence[str],
    seeds: int,
    out: Path,
    scheduler: str | None,
    progress: Callable[[int, int], None],
) -> dict[str, Any]:
    """One row for each run, setting and seed in out/sweep.csv and out/sweep.parquet.

    All keys and runs are checked before the first job. Raises UsageError, NotARunError, ConfigurationError,
    StorageError.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ModuleNotFoundError as error:
        raise UsageError("sweep writes Parquet and needs optional packages: pip install 'infant[cluster]'") from error
    grid = settings_grid(words)
    labels: list[Row] = []
    jobs = []
    for run in runs:
        header = RunReader(run).header
        for changes in grid:
            load_configuration_text(header.configuration_text, changes, f"configuration of {run}")
            for seed in range(1, seeds + 1):
                arguments = {"run": str(run.resolve()), "overrides": changes, "seed": seed}
                named = {"code": sources_hash(), "digest": f"{header.configuration_sha256} {header.created_utc}"}
                jobs.append(Job(sweep_run, {**arguments, **named}))
                labels.append({"run": printable(str(run)), **changes, "seed": seed})  # Arrow takes only UTF-8
    results = run_jobs(jobs, out / "jobs", scheduler, progress)
    rows = [{**label, **result} for label, result in zip(labels, results, strict=True)]
    write_rows(out / "sweep.csv", rows)
    table = pyarrow.Table.from_pylist(rows)
    try:
        with replacement(out / "sweep.parquet") as unfinished, unfinished.open("wb") as stream:
            parquet.write_table(table, stream)
    except OSError as error:
        raise StorageError(f"{out / 'sweep.parquet'}: cannot be written ({error}); choose another --out") from error
    return {"out": str(out), "rows": len(rows), "csv": str(out / "sweep.csv"), "parquet": str(out / "sweep.parquet")}
