"""Steps of the filter that raised are counted, named and decide the exit code of replay, evaluate and review."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from runtime.cli.__main__ import app
from runtime.record.reader import RunReader
from slam.estimate import Estimate
from slam.estimator import Estimator
from tests.support.runtime.seeded_runs import seeded_facts

FAILED_SCANS = range(20, 30)
DEFECT = "IndexError: no beam 1081 in failing"


def infant(*words: str | Path) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture(scope="module")
def replayed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """A drive of 8 s replayed with a front end that fails on ten scans, and what the command said."""
    folder = tmp_path_factory.mktemp("defects")
    seeded_facts(folder / "run", 1, duration_s=8.0)
    step, scans = Estimator._scan_step, 0

    def failing(self: Estimator, *given: object) -> Estimate:
        nonlocal scans
        scans += 1
        if scans in FAILED_SCANS:
            raise IndexError("no beam 1081")
        return step(self, *given)  # type: ignore[arg-type]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Estimator, "warm_up", classmethod(lambda *_: None))
        patch.setattr(Estimator, "_scan_step", failing)
        return folder / "out", infant("replay", folder / "run", "--out", folder / "out", "--json")


def test_replay_counts_and_names_them_and_ends_with_70(replayed: tuple[Path, Result]) -> None:
    result = replayed[1]
    summary = json.loads(result.stdout)
    assert result.exit_code == 70
    assert summary["defects"] == len(FAILED_SCANS)
    assert DEFECT in summary["defect"]


def test_the_replay_holds_them_where_they_happened(replayed: tuple[Path, Result]) -> None:
    failed = [recorded for recorded in RunReader(replayed[0]).ticks() if recorded.defect]
    assert len(failed) == len(FAILED_SCANS)
    assert all(recorded.tick.scan is not None for recorded in failed)


def test_evaluate_counts_and_names_them(replayed: tuple[Path, Result]) -> None:
    result = infant("evaluate", replayed[0])
    assert result.exit_code == 70
    assert f"DEFECT    {len(FAILED_SCANS)} of" in result.stdout
    assert DEFECT in result.stdout
    assert infant("evaluate", replayed[0], "--allow-defects").exit_code == 0


def test_review_names_the_defect_first_and_as_the_cause(replayed: tuple[Path, Result]) -> None:
    result = infant("review", replayed[0], "--json")
    report = json.loads(result.stdout)
    assert result.exit_code == 70
    assert report["defects"]["steps"] == len(FAILED_SCANS)
    assert report["findings"][0]["kind"] == "defect"
    assert DEFECT in report["findings"][0]["evidence"][0]
    assert not any("particles" in finding["remedy"] for finding in report["findings"])
    assert infant("review", replayed[0], "--allow-defects", "--json").exit_code == 0


def test_a_replay_that_does_not_fail_forgets_the_defects_of_the_one_before(replayed: tuple[Path, Result]) -> None:
    again = replayed[0].with_name("again")
    assert infant("replay", replayed[0], "--out", again, "--json").exit_code == 0
    assert not any(recorded.defect for recorded in RunReader(again).ticks())
