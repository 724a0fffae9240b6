import os
import signal
from pathlib import Path

import pytest

from runtime.errors import StorageError, UsageError
from runtime.studies.jobs import Job, run_jobs


def square(value: int, calls: str) -> dict[str, int]:
    with open(calls, "a") as stream:
        stream.write(f"{value}\n")
    return {"square": value * value}


def dies_once(marker: str) -> dict[str, bool]:
    """Kills the worker that runs it the first time."""
    if not Path(marker).exists():
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return {"survived": True}


def ignore(_done: int, _total: int) -> None: ...


def test_results_come_in_the_order_of_the_jobs_and_progress_reaches_the_end(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    jobs = [Job(square, {"value": value, "calls": str(tmp_path / "calls")}) for value in (3, 1, 2)]
    results = run_jobs(jobs, tmp_path / "results", None, lambda done, total: seen.append((done, total)))
    assert [result["square"] for result in results] == [9, 1, 4]
    assert seen == [(0, 3), (1, 3), (2, 3), (3, 3)]


def test_a_finished_job_is_not_run_twice(tmp_path: Path) -> None:
    calls = tmp_path / "calls"
    jobs = [Job(square, {"value": value, "calls": str(calls)}) for value in (1, 2)]
    run_jobs(jobs[:1], tmp_path / "results", None, ignore)
    run_jobs([*jobs, jobs[0]], tmp_path / "results", None, ignore)
    assert calls.read_text().split() == ["1", "2"]


def test_a_half_written_result_does_not_count(tmp_path: Path) -> None:
    job = Job(square, {"value": 4, "calls": str(tmp_path / "calls")})
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / f".{job.key}.json.0123456789abcdef.unfinished").write_text('{"squ')
    assert run_jobs([job], tmp_path / "results", None, ignore) == [{"square": 16}]


@pytest.mark.parametrize("content", [b'{"squ', b"[1]", b"[" * 100_000, b"\xff\xfe", b'"\x1b[2J"', None])
def test_a_file_that_is_no_result_is_one_printable_sentence_with_its_name(
    tmp_path: Path, content: bytes | None
) -> None:
    job = Job(square, {"value": 4, "calls": str(tmp_path / "calls")})
    path = tmp_path / f"{job.key}.json"
    if content is None:
        os.mkfifo(path)
    else:
        path.write_bytes(content)
    with pytest.raises(StorageError, match=rf"{path} is not the result of a finished job .*; remove it") as refused:
        run_jobs([job], tmp_path, None, ignore)
    assert str(refused.value).isprintable()


def test_two_jobs_differ_by_their_arguments() -> None:
    assert Job(square, {"value": 1, "calls": ""}).key != Job(square, {"value": 2, "calls": ""}).key


def test_a_cluster_gives_the_same_results_and_a_dead_worker_loses_none(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="needs the extra: cluster")
    jobs = [Job(square, {"value": value, "calls": str(tmp_path / "calls")}) for value in range(4)]
    jobs.append(Job(dies_once, {"marker": str(tmp_path / "marker")}))
    results = run_jobs(jobs, tmp_path / "on-cluster", "local", ignore)
    assert results[:4] == run_jobs(jobs[:4], tmp_path / "here", None, ignore)
    assert results[4] == {"survived": True}


def test_an_address_where_nothing_answers_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("runtime.studies.jobs.CONNECT_S", 0.5)
    pytest.importorskip("distributed", reason="needs the extra: cluster")
    with pytest.raises(UsageError, match=r"tcp://127\.0\.0\.1:1: no dask scheduler"):
        run_jobs([Job(square, {"value": 1, "calls": ""})], tmp_path, "tcp://127.0.0.1:1", ignore)
