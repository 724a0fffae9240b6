"""The folder of a run is whole, or gone."""

from pathlib import Path

import pytest

from runtime.errors import StorageError
from runtime.record.folder import RunFolder


@pytest.mark.parametrize("target", ["empty", "file", "nothing"])
def test_no_run_goes_where_a_link_points(tmp_path: Path, target: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("")
    (tmp_path / "run").symlink_to(tmp_path / target)
    with pytest.raises(
        StorageError, match=r"run cannot be created \(it is a link, and nothing is written through links"
    ):
        RunFolder.create(tmp_path / "run", tmp_path)
    assert {path.name for path in tmp_path.rglob("*")} == {"empty", "file", "run"}
