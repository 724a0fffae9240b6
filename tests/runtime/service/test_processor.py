"""Processors are of one kind whatever they and their libraries are called; how those compute is told to people."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from runtime.record.header import installed_versions, other_versions
from runtime.service import processor
from runtime.service.processor import NAMES, other_kind, processor_facts

HERE = installed_versions()


def test_the_header_says_processor_instructions_blas_and_libm() -> None:
    assert set(NAMES) <= HERE.keys()
    assert all(HERE[name] for name in NAMES)
    assert "results " in HERE["blas"]
    assert "results " in HERE["libm"]


def test_another_machine_is_another_kind_and_another_name_or_library_is_not() -> None:
    assert other_kind({**HERE, "machine": "vax\x1b"}, HERE) == f"machine vax\\x1b, here {HERE['machine']}"
    assert other_kind({**HERE, "processor": "another", "blas": "Zen, results 0", "libm": "musl, results 0"}, HERE) == ""


def test_a_record_of_an_earlier_release_is_of_no_other_kind() -> None:
    old = {name: value for name, value in HERE.items() if name not in NAMES}
    assert other_kind(old, HERE) == ""
    assert other_versions(old) == []


@pytest.mark.skipif(
    "avx2" not in HERE["instructions"], reason="the cores differ only where there are wide instructions"
)
def test_other_kernels_of_blas_are_noticed_by_what_they_compute() -> None:
    script = "from runtime.service.processor import processor_facts; print(processor_facts()['blas'])"
    environment = {**os.environ, "OPENBLAS_CORETYPE": "Nehalem"}
    said = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert said.stdout.startswith("Nehalem, results ")
    assert said.stdout.split()[-1] != processor_facts()["blas"].split()[-1]


def test_a_library_that_lies_behind_a_blank_or_is_gone_stops_no_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = "7f00-7f01 r-xp 00000000 08:01 12    "
    (tmp_path / "maps").write_text(f"{head}{tmp_path}/my rover/libopenblas.so\n{head}/lib/libopenblas.so (deleted)\n")
    asked: list[str] = []

    def load(path: str) -> None:
        asked.append(path)
        raise OSError("cannot open shared object file")

    monkeypatch.setattr(processor, "MAPS", tmp_path / "maps")
    monkeypatch.setattr("ctypes.CDLL", load)
    assert processor._blas_core() == "unknown"
    assert f"{tmp_path}/my rover/libopenblas.so" in asked
