"""Fixtures of the whole suite."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from runtime.source_tree import SHARED_DATA

RECORDED = Path(os.environ.get("INFANT_DATA", SHARED_DATA))


@pytest.fixture(scope="session")
def recorded_data() -> Callable[[str], Path]:
    """Path of a real recording by name; skips with the reason where the recordings are absent."""

    def folder(name: str) -> Path:
        path = (RECORDED / name).resolve()
        if not path.exists():
            pytest.skip(f"recording {name} is not in {RECORDED}; set INFANT_DATA to the folder that has it")
        return path

    return folder
