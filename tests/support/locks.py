"""Whether the systems that we promise can install what the locks pin, by what the index said of each file."""

import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TypedDict

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.tags import Tag, compatible_tags, cpython_tags
from packaging.utils import parse_wheel_filename

ROOT = Path(__file__).parents[2]
LOCKS = (ROOT / "requirements.lock", ROOT / "requirements-dev.lock")
FACTS = ROOT / "requirements.facts.json"

PURE_SOURCES = frozenset({"hokuyolx"})  # no wheel; the source distribution holds nothing to compile
LEGACY_TAGS = {(2, 17): "manylinux2014", (2, 12): "manylinux2010", (2, 5): "manylinux1"}  # PEP 600
OLDEST_GLIBC = {"x86_64": 5, "aarch64": 17}  # minor version, PEP 600


class Facts(TypedDict):
    """What the index said of one version; files: name by SHA-256; requires_python: empty where no system needs it."""

    requires_python: str
    files: dict[str, str]


@dataclass(frozen=True, slots=True)
class System:
    """A Python on a Linux machine."""

    name: str
    python: str
    glibc: tuple[int, int]
    machine: str

    def __str__(self) -> str:
        return f"{self.name} ({self.python}, {self.machine})"

    def tags(self) -> frozenset[Tag]:
        """All that a wheel's name may say and pip takes it here."""
        version = tuple(int(part) for part in self.python.split(".")[:2])
        interpreter = f"cp{version[0]}{version[1]}"
        platforms = list(self._platforms())
        return frozenset(
            chain(
                cpython_tags(version, platforms=platforms), compatible_tags(version, interpreter, platforms=platforms)
            )
        )

    def _platforms(self) -> Iterator[str]:
        major, newest = self.glibc
        for minor in range(newest, OLDEST_GLIBC[self.machine] - 1, -1):
            yield f"manylinux_{major}_{minor}_{self.machine}"
            if (major, minor) in LEGACY_TAGS:
                yield f"{LEGACY_TAGS[major, minor]}_{self.machine}"
        yield f"linux_{self.machine}"

    def needs(self, requirement: Requirement) -> bool:
        """Whether a line of a lock is meant for this system."""
        if requirement.marker is None:
            return True
        return requirement.marker.evaluate(
            {
                "implementation_name": "cpython",
                "implementation_version": self.python,
                "os_name": "posix",
                "platform_machine": self.machine,
                "platform_python_implementation": "CPython",
                "platform_system": "Linux",
                "python_full_version": self.python,
                "python_version": self.python.rpartition(".")[0],
                "sys_platform": "linux",
            }
        )


SYSTEMS = tuple(
    System(name, python, glibc, machine)
    for name, python, glibc in (
        ("oldest Python", "3.11.0", (2, 36)),
        ("Debian 12", "3.11.2", (2, 36)),
        ("Ubuntu 24.04", "3.12.3", (2, 39)),
        ("Debian 13", "3.13.5", (2, 41)),
        ("newest Python", "3.14.0", (2, 41)),
    )
    for machine in OLDEST_GLIBC
)


@dataclass(frozen=True, slots=True)
class Pin:
    """One package of a lock: name==version, for whom, and the SHA-256 of each file that may be taken."""

    requirement: Requirement
    hashes: frozenset[str]

    @property
    def key(self) -> str:
        """Its name in the facts."""
        return f"{self.requirement.name}{self.requirement.specifier}"


def pins_of(text: str) -> list[Pin]:
    """The pins of a lock's text."""
    lines = [line for line in text.replace("\\\n", " ").splitlines() if line[:1].strip(" #")]
    return [
        Pin(Requirement(line.partition(" --hash")[0]), frozenset(re.findall(r"--hash=sha256:(\w+)", line)))
        for line in lines
    ]


def read_facts() -> dict[str, Facts]:
    """What `make lock` has written down."""
    facts: dict[str, Facts] = json.loads(FACTS.read_text(encoding="utf-8"))
    return facts


def unexplained(pins: Iterable[Pin], facts: dict[str, Facts]) -> list[str]:
    """Pins whose hashes are not those of the facts: the facts are stale."""
    return [pin.key for pin in pins if pin.key not in facts or pin.hashes != facts[pin.key]["files"].keys()]


def troubles(pins: Iterable[Pin], facts: dict[str, Facts], system: System) -> list[str]:
    """One sentence for each pin that the system needs and cannot install."""
    found = []
    tags = system.tags()
    taken: set[str] = set()
    for pin in (pin for pin in pins if system.needs(pin.requirement)):
        known = facts[pin.key]
        if pin.requirement.name in taken:
            found.append(f"{system}: {pin.requirement.name} is pinned twice")
        taken.add(pin.requirement.name)
        if not SpecifierSet(known["requires_python"] or "<0").contains(system.python):
            found.append(f"{system}: {pin.key} requires Python {known['requires_python'] or 'of an unknown version'}")
        if not any(fits(name, tags) for name in known["files"].values()):
            found.append(f"{system}: {pin.key} has no wheel for it")
    return found


def fits(name: str, tags: frozenset[Tag]) -> bool:
    """Whether a file of this name can be installed without a compiler."""
    if name.endswith(".whl"):
        return not parse_wheel_filename(name)[3].isdisjoint(tags)
    return name.rpartition("-")[0] in PURE_SOURCES
