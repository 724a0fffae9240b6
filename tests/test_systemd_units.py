"""The units parse, name nothing unknown and stay hardened; no running systemd is needed."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from runtime.source_tree import ROOT

SYSTEMD = ROOT / "systemd"
EXPOSURE_LIMIT = 2.1

pytestmark = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed (package systemd)"
)


def analyze(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["systemd-analyze", *words], capture_output=True, text=True, timeout=600, check=False)


def exposure(unit: Path) -> float:
    result = analyze("security", "--offline=true", str(unit))
    found = re.search(r"Overall exposure level for \S+: ([0-9.]+)", result.stdout)
    assert found, result.stdout + result.stderr
    return float(found.group(1))


@pytest.mark.parametrize("unit", sorted(SYSTEMD.glob("*.service")), ids=lambda unit: unit.name)
def test_a_unit_exposes_little(unit: Path) -> None:
    assert exposure(unit) <= EXPOSURE_LIMIT


@pytest.mark.parametrize("unit", sorted(SYSTEMD.glob("*.service")), ids=lambda unit: unit.name)
def test_a_unit_has_no_key_that_systemd_does_not_know(unit: Path, tmp_path: Path) -> None:
    # the program is not installed where tests run; its place is taken by one that is
    for path in SYSTEMD.glob("*.service"):
        text = path.read_text().replace("/opt/infant/.venv/bin/infant", "/bin/true")
        (tmp_path / path.name).write_text(text)
    result = analyze("verify", "--man=no", str(tmp_path / unit.name))
    complaints = [line for line in result.stderr.splitlines() if "Unknown" in line or "Failed to parse" in line]
    assert not complaints, "\n".join(complaints)


def test_the_check_tells_an_open_unit_from_a_hardened_one(tmp_path: Path) -> None:
    plain = tmp_path / "plain.service"
    plain.write_text("[Service]\nExecStart=/bin/true\n")
    assert exposure(plain) > EXPOSURE_LIMIT


def test_the_watchdog_and_the_restart_rules_fit_a_headless_rover() -> None:
    text = (SYSTEMD / "infant.service").read_text()
    rules = ("Type=notify", "WatchdogSec=2s", "Restart=always", "RestartPreventExitStatus=2 3", "StartLimitBurst=30")
    for line in rules:
        assert line in text.splitlines()
    assert "MemoryDenyWriteExecute=" not in re.sub(r"#.*", "", text), "numba cannot run under it"
