from pathlib import Path

import pytest

from runtime import compile_cache
from runtime.compile_cache import forget_other_versions, sources_hash, use_compile_cache


def test_the_services_own_folder_comes_first_and_a_given_one_is_respected(tmp_path: Path) -> None:
    environment = {"CACHE_DIRECTORY": str(tmp_path / "service"), "HOME": str(tmp_path)}
    folder = use_compile_cache(environment)
    assert folder == tmp_path / "service" / "kernels" / sources_hash()
    assert environment["NUMBA_CACHE_DIR"] == str(folder)
    assert use_compile_cache({"NUMBA_CACHE_DIR": "/given", "HOME": "/"}) == Path("/given")


def test_a_home_that_cannot_be_written_is_no_obstacle() -> None:
    folder = use_compile_cache({"HOME": "/proc/nobody"})
    assert folder.is_dir()
    assert "/proc" not in str(folder)


def test_a_changed_source_gets_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compile_cache, "SOURCES", tmp_path)
    (tmp_path / "kernels.py").write_text("a = 1\n")
    before = sources_hash()
    (tmp_path / "kernels.py").write_text("a = 2\n")
    assert sources_hash() != before


def test_only_other_versions_are_forgotten(tmp_path: Path) -> None:
    kept = use_compile_cache({"XDG_CACHE_HOME": str(tmp_path)})
    (kept.parent / "older").mkdir()
    (kept.parent / "older" / "x.nbi").touch()
    forget_other_versions(kept)
    assert [path.name for path in kept.parent.iterdir()] == [sources_hash()]
    forget_other_versions(tmp_path)  # not a folder of ours
    assert kept.is_dir()
