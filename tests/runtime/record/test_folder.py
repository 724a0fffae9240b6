"""The folder of a run is whole, or gone."""

from pathlib import Path

import pytest

from runtime.record.folder import RunFolder


def test_a_folder_that_was_interrupted_is_taken_away_and_one_that_failed_is_kept(tmp_path: Path) -> None:
    for error, kept in ((KeyboardInterrupt, False), (OSError, True)):
        folder = RunFolder.create(tmp_path / error.__name__, tmp_path)
        folder.write_summary({})
        with pytest.raises(error), folder.gone_if_interrupted():
            raise error
        assert folder.path.exists() == kept
