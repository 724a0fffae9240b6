"""Every machine that we promise can install what the locks pin."""

import platform
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.tags import sys_tags
from packaging.utils import canonicalize_name

from tests.support.locks import (
    LOCKS,
    PURE_SOURCES,
    ROOT,
    SYSTEMS,
    Facts,
    Pin,
    System,
    pins_of,
    read_facts,
    troubles,
    unexplained,
)

RUN_LOCK, DEV_LOCK = LOCKS
DEBIAN_12, DEBIAN_12_ARM = (
    next(each for each in SYSTEMS if (each.name, each.machine) == ("Debian 12", machine))
    for machine in ("x86_64", "aarch64")
)
DEBIAN_13 = next(each for each in SYSTEMS if (each.name, each.machine) == ("Debian 13", "x86_64"))


def locked(lock: Path) -> list[Pin]:
    return pins_of(lock.read_text(encoding="utf-8"))


def project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("system", SYSTEMS, ids=str)
@pytest.mark.parametrize("lock", LOCKS, ids=lambda lock: lock.name)
def test_each_promised_system_can_install_the_lock(lock: Path, system: System) -> None:
    assert troubles(locked(lock), read_facts(), system) == []


@pytest.mark.parametrize("lock", LOCKS, ids=lambda lock: lock.name)
def test_each_hash_of_a_lock_is_of_a_file_that_the_facts_name(lock: Path) -> None:
    pins = locked(lock)
    assert len(pins) > 40
    assert unexplained(pins, read_facts()) == [], "the facts are stale; run 'make lock'"


def test_the_facts_hold_nothing_that_no_lock_pins() -> None:
    assert read_facts().keys() == {pin.key for lock in LOCKS for pin in locked(lock)}


def test_sources_are_installed_only_where_there_is_no_wheel() -> None:
    without_wheel = {
        key.partition("==")[0]
        for key, known in read_facts().items()
        if not any(name.endswith(".whl") for name in known["files"].values())
    }
    assert without_wheel == PURE_SOURCES


def test_both_locks_pin_the_same_versions() -> None:
    developers = {pin.key: pin.hashes for pin in locked(DEV_LOCK)}
    assert [pin.key for pin in locked(RUN_LOCK) if developers.get(pin.key) != pin.hashes] == []


@pytest.mark.parametrize(("lock", "extras"), [(RUN_LOCK, {"review"}), (DEV_LOCK, {"dev"})], ids=["run", "dev"])
def test_a_lock_pins_what_the_project_asks_for(lock: Path, extras: set[str]) -> None:
    asked, versions = project(), {pin.requirement.name: pin.requirement.specifier for pin in locked(lock)}
    lines = [*asked["project"]["dependencies"], *asked["dependency-groups"]["build"]]
    for extra in extras:
        lines += asked["project"]["optional-dependencies"][extra]
    for wanted in map(Requirement, lines):
        if wanted.name == asked["project"]["name"]:
            continue
        (pinned,) = versions[canonicalize_name(wanted.name)]
        assert wanted.specifier.contains(pinned.version), f"{wanted}: the lock has {pinned.version}; run 'make lock'"


def test_the_locks_hold_what_builds_the_package() -> None:
    assert project()["dependency-groups"]["build"] == project()["build-system"]["requires"]


WHEEL_X86 = "made_up-1.0-cp311-cp311-manylinux_2_17_x86_64.manylinux2014_x86_64.whl"


@pytest.mark.parametrize(
    ("name", "requires_python", "system", "word"),
    [
        ("made_up-1.0-py3-none-any.whl", ">=3.11.5", DEBIAN_12, "requires Python >=3.11.5"),
        ("made_up-1.0-py3-none-any.whl", ">=3.11.5", DEBIAN_13, ""),
        ("made_up-1.0-py3-none-any.whl", "<3.13", DEBIAN_13, "requires Python <3.13"),
        ("made_up-1.0-py3-none-any.whl", "", DEBIAN_12, "unknown version"),
        ("made_up-1.0-py3-none-manylinux_2_40_x86_64.whl", ">=3.8", DEBIAN_12, "no wheel"),
        ("made_up-1.0-py3-none-manylinux_2_40_x86_64.whl", ">=3.8", DEBIAN_13, ""),
        (WHEEL_X86, ">=3.8", DEBIAN_12, ""),
        (WHEEL_X86, ">=3.8", DEBIAN_12_ARM, "no wheel"),
        (WHEEL_X86, ">=3.8", DEBIAN_13, "no wheel"),
        ("made_up-1.0-cp310-abi3-manylinux_2_28_x86_64.whl", ">=3.8", DEBIAN_13, ""),
        ("made_up-1.0-cp312-abi3-manylinux_2_28_x86_64.whl", ">=3.8", DEBIAN_12, "no wheel"),
        ("made_up-1.0-cp311-cp311-musllinux_1_2_x86_64.whl", ">=3.8", DEBIAN_12, "no wheel"),
        ("made_up-1.0-cp311-cp311-win_amd64.whl", ">=3.8", DEBIAN_12, "no wheel"),
        ("made_up-1.0.tar.gz", ">=3.8", DEBIAN_12, "no wheel"),
        ("hokuyolx-0.9.0.tar.gz", ">=3.8", DEBIAN_12, ""),
    ],
)
def test_a_package_that_cannot_be_installed_is_found(
    name: str, requires_python: str, system: System, word: str
) -> None:
    pins = pins_of("made-up==1.0 \\\n    --hash=sha256:0a\n    # via infant\n")
    found = troubles(pins, {"made-up==1.0": Facts(requires_python=requires_python, files={"0a": name})}, system)
    assert len(found) == (1 if word else 0)
    assert word in "".join(found)


def test_a_pin_counts_only_for_the_systems_that_its_marker_names() -> None:
    lock = (
        "made-up==2.0 ; python_full_version >= '3.11.5' \\\n    --hash=sha256:0a\n"
        "made-up==1.0 ; python_full_version < '3.13' and platform_machine != 'aarch64' \\\n    --hash=sha256:0b\n"
    )
    facts = {
        "made-up==2.0": Facts(requires_python=">=3.11.5", files={"0a": "made_up-2.0-py3-none-any.whl"}),
        "made-up==1.0": Facts(requires_python=">=3.8", files={"0b": "made_up-1.0-py3-none-any.whl"}),
    }
    pins = pins_of(lock)
    assert troubles(pins, facts, DEBIAN_12) == []
    assert troubles(pins, facts, DEBIAN_13) == []
    assert troubles(pins, facts, System("both", "3.12.3", (2, 39), "x86_64")) == [
        "both (3.12.3, x86_64): made-up is pinned twice"
    ]


@pytest.mark.parametrize("known", [{}, {"0b": "made_up-1.0.tar.gz"}, {"0a": "a.whl", "0b": "made_up-1.0.tar.gz"}])
def test_a_hash_that_the_facts_do_not_explain_is_found(known: dict[str, str]) -> None:
    pins = pins_of("made-up==1.0 \\\n    --hash=sha256:0a\n")
    assert unexplained(pins, {"made-up==1.0": Facts(requires_python=">=3.8", files=known)}) == ["made-up==1.0"]
    assert unexplained(pins, {}) == ["made-up==1.0"]


def test_the_tags_of_a_system_are_those_that_packaging_finds_on_this_one() -> None:
    if sys.platform != "linux" or platform.machine() not in {each.machine for each in SYSTEMS}:
        pytest.skip("the locks are not promised for this kind of machine")
    major, minor = platform.libc_ver()[1].split(".")
    here = System("here", platform.python_version(), (int(major), int(minor)), platform.machine())
    assert here.tags() == {tag for tag in sys_tags() if "musllinux" not in tag.platform}
