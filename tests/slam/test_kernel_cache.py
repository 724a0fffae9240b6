import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from runtime.source_tree import ROOT
from slam import kernel_cache
from slam.kernel_cache import forget_other_versions, hash_of_files, sources_hash, use_compile_cache

NOBODY = 65534


def test_the_services_own_folder_comes_first_and_a_given_one_is_respected(tmp_path: Path) -> None:
    environment = {"CACHE_DIRECTORY": str(tmp_path / "service"), "HOME": str(tmp_path)}
    folder = use_compile_cache(environment)
    assert folder == tmp_path / "service" / "kernels" / sources_hash()
    assert environment["NUMBA_CACHE_DIR"] == str(folder)
    given = {"NUMBA_CACHE_DIR": str(tmp_path / "given"), "HOME": "/"}
    assert use_compile_cache(given) == tmp_path / "given" / "kernels" / sources_hash()
    assert use_compile_cache(given) == tmp_path / "given" / "kernels" / sources_hash(), "a child would nest another"


def test_a_home_that_cannot_be_written_is_no_obstacle() -> None:
    folder = use_compile_cache({"HOME": "/proc/nobody"})
    assert folder.is_dir()
    assert "/proc" not in str(folder)


def test_a_version_that_is_used_is_not_old(tmp_path: Path) -> None:
    folder = use_compile_cache({"XDG_CACHE_HOME": str(tmp_path)})
    os.utime(folder, (1e9, 1e9))
    assert use_compile_cache({"XDG_CACHE_HOME": str(tmp_path)}).stat().st_mtime > 1e9


def test_a_changed_source_gets_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "SOURCES", tmp_path)
    (tmp_path / "kernels.py").write_text("a = 1\n")
    before = sources_hash()
    (tmp_path / "kernels.py").write_text("a = 2\n")
    assert sources_hash() != before


def test_two_files_of_one_name_in_different_folders_are_told_apart(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    (tmp_path / "a" / "kernels.py").write_text("a = 1\n")
    before = hash_of_files(tmp_path, tmp_path.rglob("*.py"))
    (tmp_path / "a" / "kernels.py").rename(tmp_path / "b" / "kernels.py")
    assert hash_of_files(tmp_path, tmp_path.rglob("*.py")) != before


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can make a folder that belongs to another user")
@pytest.mark.parametrize("planted", ["kernels/{}", "kernels", ""])
def test_a_folder_planted_by_another_user_is_not_opened(tmp_path: Path, planted: str) -> None:
    (tmp_path / "infant" / "kernels" / sources_hash()).mkdir(mode=0o700, parents=True)
    os.chown(tmp_path / "infant" / planted.format(sources_hash()), NOBODY, NOBODY)
    assert not use_compile_cache({"XDG_CACHE_HOME": str(tmp_path)}).is_relative_to(tmp_path)


def test_a_folder_that_others_may_write_is_not_opened(tmp_path: Path) -> None:
    folder = tmp_path / "infant" / "kernels" / sources_hash()
    folder.mkdir(mode=0o700, parents=True)
    assert use_compile_cache({"XDG_CACHE_HOME": str(tmp_path)}) == folder
    folder.chmod(0o777)
    assert not use_compile_cache({"XDG_CACHE_HOME": str(tmp_path)}).is_relative_to(tmp_path)


def test_a_link_to_a_folder_elsewhere_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    (tmp_path / "infant" / "kernels").mkdir(mode=0o700, parents=True)
    (tmp_path / "infant" / "kernels" / sources_hash()).symlink_to(tmp_path / "elsewhere")
    assert not use_compile_cache({"XDG_CACHE_HOME": str(tmp_path)}).is_relative_to(tmp_path)


def test_an_edited_callee_is_compiled_anew_without_the_command_line(tmp_path: Path) -> None:
    """`from slam... import` in a notebook: numba alone would run the old machine code of the caller."""
    for package in ("slam", "drivers"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    callee = tmp_path / "slam" / "angles.py"
    before = heading_of(tmp_path)
    text = callee.read_text()
    assert "    return angle\n\n\n@leaf\ndef half_turn" in text
    callee.write_text(text.replace("    return angle\n\n\n@leaf", "    return angle + 0.25\n\n\n@leaf", 1))
    assert heading_of(tmp_path) == pytest.approx(before + 0.25)


def heading_of(tree: Path) -> float:
    """What a kernel that calls `wrapped` gives in a process that knows nothing of the command line."""
    program = (
        "import numpy as np\n"
        "from slam.particles.step import predict\n"
        "pose = np.zeros(3)\n"
        "predict(pose, np.zeros((3, 3)), np.array((0.0, 0.0, 0.5)), np.zeros((3, 3)))\n"
        "print(pose[2])\n"
    )
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment |= {"XDG_CACHE_HOME": str(tree / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tree, env=environment, capture_output=True, text=True, check=True
    )
    return float(done.stdout)


def test_only_versions_that_nobody_uses_any_more_are_forgotten(tmp_path: Path) -> None:
    kept = use_compile_cache({"XDG_CACHE_HOME": str(tmp_path)})
    for name, days in (("of-another-checkout", 20), ("older", 31)):
        (kept.parent / name).mkdir()
        (kept.parent / name / "x.nbi").touch()
        used_s = kept.stat().st_mtime - days * 86400.0
        os.utime(kept.parent / name, (used_s, used_s))
    forget_other_versions(kept)
    assert {path.name for path in kept.parent.iterdir()} == {sources_hash(), "of-another-checkout"}
    forget_other_versions(tmp_path)  # not a folder of ours
    assert kept.is_dir()
