"""Write down what the index says of every file in the locks, so that tests/test_locks.py needs no network.

`make lock` runs it. uv names the files of each version, pip the Python that each version requires. uv names only files
that some Python from 3.11 on can take; the hashes of the others leave the locks, so that every hash has its file.
"""

import json
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from packaging.utils import canonicalize_name

from tests.support.locks import FACTS, LOCKS, SYSTEMS, Facts, Pin, pins_of

UV = Path(sys.executable).with_name("uv")
ASK_UV = (UV, "pip", "compile", "--quiet", "--universal", "--no-deps", "--python-version", "3.11")
ASK_PIP = (sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed", "--ignore-requires-python")


def main() -> None:
    """Write FACTS anew, and take hashes of files for older Pythons out of the locks."""
    pins = {str(pin.requirement): pin for lock in LOCKS for pin in pins_of(lock.read_text(encoding="utf-8"))}
    files = files_by_key(pins.values())
    pythons = required_pythons(pins.values())
    facts: dict[str, Facts] = {
        key: {"requires_python": pythons.get(key, ""), "files": files[key]} for key in sorted(files)
    }
    for lock in LOCKS:
        lock.write_text(without_others(lock.read_text(encoding="utf-8"), facts), encoding="utf-8")
    FACTS.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


def without_others(lock: str, facts: Mapping[str, Facts]) -> str:
    """The lock's text with only those hashes whose files are known."""
    known = {sha256 for version in facts.values() for sha256 in version["files"]}
    return re.sub(r" \\\n    --hash=sha256:(\w+)", lambda hash_: hash_[0] if hash_[1] in known else "", lock)


def files_by_key(pins: Iterable[Pin]) -> dict[str, dict[str, str]]:
    """Names of the files of each pinned version, by SHA-256."""
    with tempfile.TemporaryDirectory() as folder:
        source = _requirements(folder, (str(pin.requirement) for pin in pins))
        said = subprocess.run([*ASK_UV, "--format", "pylock.toml", source], check=True, capture_output=True, text=True)
    packages: list[dict[str, Any]] = tomllib.loads(said.stdout)["packages"]
    return {f"{package['name']}=={package['version']}": _files(package) for package in packages}


def _files(package: dict[str, Any]) -> dict[str, str]:
    files = [*package.get("wheels", ()), *filter(None, [package.get("sdist")])]
    named = sorted((file["url"].rpartition("/")[2], file["hashes"]["sha256"]) for file in files)
    return {sha256: name for name, sha256 in named}


def required_pythons(pins: Iterable[Pin]) -> dict[str, str]:
    """Requires-Python of each pinned version that one of SYSTEMS needs; ">=0" where a version requires none."""
    needed = [pin for pin in pins if any(system.needs(pin.requirement) for system in SYSTEMS)]
    required: dict[str, str] = {}
    while needed:  # pip takes one version of a name at a time
        batch = {pin.requirement.name: pin for pin in needed}
        needed = [pin for pin in needed if pin is not batch[pin.requirement.name]]
        with tempfile.TemporaryDirectory() as folder:
            source = _requirements(folder, (pin.key for pin in batch.values()))
            report = Path(folder) / "report.json"
            subprocess.run([*ASK_PIP, "--quiet", "--no-deps", "--report", report, "-r", source], check=True)
            installs: list[dict[str, Any]] = json.loads(report.read_text(encoding="utf-8"))["install"]
        for told in installs:
            metadata = told["metadata"]
            pin = batch[canonicalize_name(metadata["name"])]
            required[pin.key] = metadata.get("requires_python", ">=0")
    return required


def _requirements(folder: str, lines: Iterable[str]) -> Path:
    path = Path(folder) / "requirements.txt"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


if __name__ == "__main__":
    main()
