import os
import subprocess
import threading
from pathlib import Path
from typing import Self

import pytest

from runtime.live import kernels
from runtime.live.deadline import TimeIsOver
from slam.estimator import Estimator
from slam.kernel_cache import sources_hash
from slam.settings.slam import SlamSettings

GO_ON = threading.Event()


@pytest.fixture
def compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Commands by which kernels were compiled; loading is left out."""
    commands: list[object] = []
    tmp_path.chmod(0o700)
    (tmp_path / "kernels" / sources_hash()).mkdir(parents=True, mode=0o700)
    (tmp_path / "kernels").chmod(0o700)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels" / sources_hash()))

    class Compiling:
        """Writes one index file, then is done."""

        def __init__(self, command: object, start_new_session: bool) -> None:
            self._waits = 0
            commands.append(command)

        def terminate(self) -> None:
            commands.append("terminated")

        def __enter__(self) -> Self:
            return self

        def __exit__(self, *_error: object) -> None:
            pass

        def wait(self, timeout_s: float) -> None:
            self._waits += 1
            if self._waits == 1:
                (tmp_path / "kernels" / sources_hash() / "a.nbi").touch()
                raise subprocess.TimeoutExpired("compile", timeout_s)

    monkeypatch.setattr(subprocess, "Popen", Compiling)
    monkeypatch.setattr(Estimator, "warm_up", lambda settings: None)
    return commands


def test_an_empty_cache_is_filled_by_another_process_and_only_once(
    compiled: list[object], capsys: pytest.CaptureFixture[str]
) -> None:
    of_another_checkout = Path(os.environ["NUMBA_CACHE_DIR"]) / "old.nbi"
    of_another_checkout.touch()
    os.utime(of_another_checkout, (1e9, 1e9))
    kernels.load_kernels(SlamSettings(), print, GO_ON)
    kernels.load_kernels(SlamSettings(), print, GO_ON)
    assert compiled == [kernels.COMPILE]
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("starting: compiling kernels 0 of ")
    assert second.startswith("starting: compiling kernels 1 of ")


def test_a_file_that_was_written_again_is_compiled_again(compiled: list[object], tmp_path: Path) -> None:
    """numba compares times: a checkout that changes no byte makes it compile."""
    kernels.load_kernels(SlamSettings(), print, GO_ON)
    sources = tmp_path / "slam"
    sources.mkdir()
    (sources / "a.py").write_text("")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernels, "SOURCES", sources)
        kernels.load_kernels(SlamSettings(), print, GO_ON)
        kernels.load_kernels(SlamSettings(), print, GO_ON)
        os.utime(sources / "a.py", ns=(1, 1))
        kernels.load_kernels(SlamSettings(), print, GO_ON)
    assert len(compiled) == 3


def test_after_warmup_the_first_run_needs_no_other_process(compiled: list[object]) -> None:
    kernels.mark_complete(Path(os.environ["NUMBA_CACHE_DIR"]))
    kernels.load_kernels(SlamSettings(), print, GO_ON)
    assert compiled == []


def test_a_run_that_is_stopped_while_kernels_compile_ends_the_compiler_and_loads_none(
    compiled: list[object], monkeypatch: pytest.MonkeyPatch
) -> None:
    stop, loaded = threading.Event(), list[object]()
    monkeypatch.setattr(Estimator, "warm_up", loaded.append)
    kernels.load_kernels(SlamSettings(), lambda _progress: stop.set(), stop)
    assert compiled == [kernels.COMPILE, "terminated"]
    assert loaded == []
    kernels.load_kernels(SlamSettings(), print, GO_ON)
    assert len(loaded) == 1


def test_a_run_whose_time_is_over_while_kernels_compile_ends_the_compiler_and_says_how_to_compile_beforehand(
    compiled: list[object],
) -> None:
    def over(_progress: str) -> None:
        raise TimeIsOver

    with pytest.raises(TimeIsOver, match="'infant warmup' does it beforehand"):
        kernels.load_kernels(SlamSettings(), over, GO_ON)
    assert compiled == [kernels.COMPILE, "terminated"]
