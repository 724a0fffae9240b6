"""What stands once at the head of a run: configuration, versions, boot, and the offset to wall time."""

import hashlib
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from runtime.errors import NotARunError
from runtime.messages.believed import FAR_NS
from runtime.printable import printable
from runtime.record.folder import MOST_SEGMENTS
from runtime.record.mcap_prefix import McapPrefix
from runtime.service.processor import NAMES, processor_facts
from slam.kernel_cache import sources_hash

FORMAT = "1"
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")

PACKAGES = (
    *("infant", "numpy", "scipy", "numba", "python-can", "pyserial"),
    *("eclipse-zenoh", "rerun-sdk", "mcap", "rosbags"),
)


def installed_versions() -> dict[str, str]:
    """Versions of all that could change a bit of the result: Python, packages, the filter's sources, the processor."""
    versions = {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "slam sources": sources_hash(),
        **processor_facts(),
    }
    for package in PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "absent"
    return versions


def other_versions(recorded: Mapping[str, str]) -> list[str]:
    """What is not the same here as where a run was recorded, in words; of the processor tells other_kind."""
    here = installed_versions()
    return [
        f"{name} {was}, here {here.get(name, 'absent')}"
        for name, was in sorted(recorded.items())
        if here.get(name) != was and name not in NAMES
    ]


@dataclass(frozen=True, slots=True)
class RunHeader:
    """Facts that hold for a whole run.

    wall_minus_monotonic_ns: added to a stamp it gives nanoseconds since 1970; None where the recording does not tell.
    source: "live", "import NAME" or "replay of NAME". start: how it began in a saved map, empty where it began without.
    """

    configuration_text: str
    source: str
    versions: Mapping[str, str] = field(default_factory=dict)
    boot_id: str = ""
    wall_minus_monotonic_ns: int | None = None
    created_utc: str = ""
    configuration_sha256: str = ""
    start: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of_live_run(
        cls, configuration_text: str, versions: Mapping[str, str], start: Mapping[str, str] | None = None
    ) -> "RunHeader":
        """The header of a run that starts now on this host."""
        boot_id = BOOT_ID.read_text().strip() if BOOT_ID.exists() else ""
        offset_ns = time.time_ns() - time.monotonic_ns()
        created_utc = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"
        return cls(configuration_text, "live", versions, boot_id, offset_ns, created_utc, start=start or {})

    @property
    def is_import(self) -> bool:
        """Whether only inputs were recorded here; estimates are then those of a replay."""
        return self.source.startswith("import ")

    @property
    def is_of_others(self) -> bool:
        """Whether software of others recorded it: an import, or a replay of one, which no boot of ours has seen."""
        return self.is_import or (self.source.startswith("replay of ") and not self.boot_id)

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """As MCAP metadata; from_metadata gives the header back."""
        offset_ns = self.wall_minus_monotonic_ns
        return {
            "infant": {
                "format": FORMAT,
                "configuration": self.configuration_text,
                "configuration_sha256": hashlib.sha256(self.configuration_text.encode()).hexdigest(),
                "source": self.source,
                "boot_id": self.boot_id,
                "wall_minus_monotonic_ns": "" if offset_ns is None else str(offset_ns),
                "created_utc": self.created_utc,
            },
            "versions": dict(self.versions),
            **({"map": dict(self.start)} if self.start else {}),
        }

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, Mapping[str, str]]) -> "RunHeader":
        """Back again.

        Raises ValueError with one sentence: no header, another format, or a configuration that is not the one hashed.
        """
        facts = metadata.get("infant")
        if facts is None:
            raise ValueError("it has no header of infant")
        if facts.get("format") != FORMAT:
            raise ValueError(f"its format is {facts.get('format')}, but this release reads {FORMAT}")
        text = facts["configuration"]
        segment_number(metadata)
        if hashlib.sha256(text.encode()).hexdigest() != facts["configuration_sha256"]:
            raise ValueError("its configuration does not match its hash: the header is damaged")
        offset_ns = facts["wall_minus_monotonic_ns"]
        return cls(
            text,
            printable(facts["source"]),
            dict(metadata.get("versions", {})),
            facts["boot_id"],
            int(offset_ns) if offset_ns and abs(int(offset_ns)) < FAR_NS else None,
            printable(facts["created_utc"]),
            facts["configuration_sha256"],
            dict(metadata.get("map", {})),
        )


def segment_number(metadata: Mapping[str, Mapping[str, str]]) -> int | None:
    """Which segment of a run a file is, None where it does not say. Raises ValueError on what no run reaches."""
    number = metadata.get("segment", {}).get("number")
    if number is None:
        return None
    if not number.isascii() or not number.isdigit() or not 1 <= len(number) <= 6:
        raise ValueError(f"its segment has the number {number!r:.40}, expected 1 to {MOST_SEGMENTS}")
    return int(number)


def first_header(paths: list[Path]) -> tuple[McapPrefix, RunHeader]:
    """A head that can be believed: of the first segment, the last or the next; all have the same. Raises
    NotARunError.
    """
    first_refusal = None
    for path in (*paths[:1], *paths[:0:-1][:1], *paths[1:-1]):
        file = McapPrefix(path)
        file.read_head()
        try:
            return file, RunHeader.from_metadata(file.metadata)
        except (ValueError, KeyError) as error:
            why = str(error) if file.metadata else file.damage or str(error)
            said = f"{path} cannot be read as a run: {printable(why)}; nothing in it can be trusted"
            first_refusal = first_refusal or NotARunError(said)
    raise first_refusal or NotARunError("a run without a file")
