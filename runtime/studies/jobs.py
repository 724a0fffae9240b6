"""Many independent runs: each is a pure function of its arguments, done once, wherever there is a core.

A finished job is a file named by what it computes, so a call that is repeated or was cut off runs only what is
missing. With the extra `cluster`, jobs go to dask.distributed: the cores of this machine, or a scheduler's address.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runtime.bounded_read import read_bounded
from runtime.errors import StorageError, UsageError
from runtime.printable import printable
from runtime.studies.files import write

Result = dict[str, Any]
Progress = Callable[[int, int], None]
CONNECT_S = 10.0  # within which a scheduler has to answer
LARGEST_RESULT = 64 << 20  # bytes; a drive of an hour with its path has 5 MB
LONGEST_REASON = 200
RETRIES = 3  # a job whose worker dies runs again; one that kills three workers is a defect


@dataclass(frozen=True, slots=True)
class Job:
    """One call of an importable function with arguments that JSON can hold, which returns what JSON can hold."""

    function: Callable[..., Result]
    arguments: Mapping[str, Any]

    @property
    def key(self) -> str:
        """Names the computation: function and arguments, not time or place."""
        text = json.dumps(self.arguments, sort_keys=True)
        digest = hashlib.sha256(f"{self.function.__module__}.{self.function.__qualname__}{text}".encode()).hexdigest()
        return f"{self.function.__qualname__}-{digest[:24]}"

    def run(self) -> Result:
        """Compute it here."""
        return self.function(**self.arguments)


def run_jobs(jobs: Sequence[Job], folder: Path, scheduler: str | None, progress: Progress) -> list[Result]:
    """Results in the order of the jobs; `folder` keeps the finished ones.

    scheduler: address of a dask scheduler, "local" for all cores of this machine, None for this process.
    Raises UsageError when the extra is missing or no scheduler answers, StorageError for a file that is no result.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"{folder}: cannot be made ({error.strerror}); choose another --out") from error
    missing = {job.key: job for job in jobs if not _path(folder, job.key).exists()}
    done = len({job.key for job in jobs}) - len(missing)
    total = done + len(missing)
    progress(done, total)
    for key, result in _compute(missing, scheduler):
        write(_path(folder, key), json.dumps(result))  # a cut-off call leaves no half result behind
        done += 1
        progress(done, total)
    return [_result(_path(folder, job.key)) for job in jobs]


def _compute(jobs: Mapping[str, Job], scheduler: str | None) -> Iterator[tuple[str, Result]]:
    """Key and result of each job as they end."""
    if scheduler is None or not jobs:
        for key, job in jobs.items():
            yield key, job.run()
        return
    with _client(scheduler) as client:
        from distributed import as_completed

        futures = {client.submit(Job.run, job, key=key, retries=RETRIES): key for key, job in jobs.items()}
        for future in as_completed(list(futures), loop=client.loop):
            yield futures[future], future.result()


@contextmanager
def _client(scheduler: str) -> Iterator[Any]:
    try:
        import distributed
    except ModuleNotFoundError as error:
        raise UsageError(
            "--scheduler: this needs optional packages: pip install 'infant[cluster]'; or give --scheduler none"
        ) from error
    if scheduler != "local":
        try:
            client = distributed.Client(scheduler, timeout=CONNECT_S, set_as_default=False)
        except OSError as error:
            raise UsageError(f"--scheduler {scheduler}: no dask scheduler answers there; start one first") from error
        with client:
            yield client
        return
    with (
        distributed.LocalCluster(
            n_workers=os.cpu_count() or 1,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address=None,
            silence_logs=50,
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield client


def _result(path: Path) -> Result:
    """A finished job's. Raises StorageError."""
    try:
        result = json.loads(read_bounded(path, LARGEST_RESULT))
        if isinstance(result, dict):
            return result
        why = "no JSON object"
    except (OSError, ValueError, RecursionError) as error:
        why = printable(getattr(error, "strerror", "") or str(error), LONGEST_REASON)
    raise StorageError(f"{path} is not the result of a finished job ({why}); remove it, and it is computed again")


def _path(folder: Path, key: str) -> Path:
    return folder / f"{key}.json"
