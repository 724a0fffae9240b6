from pathlib import Path

import numpy as np
import pytest

from runtime.studies.recognition import study
from runtime.studies.recognition.trials import KINDS, recognition_trial, things_of


def test_the_study_counts_places_null_attempts_and_costs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "PLACES", 2)
    monkeypatch.setattr(study, "THINGS", 64)
    monkeypatch.setattr(study, "SIZES", {100: 2})
    result = study.run_recognition(1, tmp_path, None, lambda done, total: None)
    rows = {row["kind"]: row for row in result["recognition"]}
    assert list(rows) == list(KINDS)
    assert all(row["places"] == 2 and row["nulls"] == 10 for row in rows.values())
    assert rows["scattered"]["right"] == 2
    assert result["cost"][0]["landmarks"] == 100
    assert min(result["cost"][0][figure] for figure in ("slice_p99_ms", "attempt_p95_ms")) > 0.0
    assert "null attempts: 0" in (tmp_path / "recognition.md").read_text()
    assert study.run_recognition(1, tmp_path, None, lambda done, total: None)["cost"] == result["cost"]


def test_a_trial_repeats_itself() -> None:
    assert recognition_trial("in clumps", 3, 64, 2, "") == recognition_trial("in clumps", 3, 64, 2, "")


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_world_has_as_many_things_as_asked_for(kind: str) -> None:
    assert things_of(kind, np.random.default_rng(1), 100).shape == (100, 2)
