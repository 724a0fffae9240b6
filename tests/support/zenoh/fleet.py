"""A router with the rules of config/zenoh-fleet.json5 and certificates of a test authority, in this process."""

import json
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh

from runtime.settings.publish import PublishSettings
from runtime.source_tree import ROOT
from tests.support.zenoh.wire import free_port, settings_on

CONFIG = ROOT / "config"


@dataclass(frozen=True)
class Fleet:
    """A router that is up, and where it is."""

    certificates: Path
    endpoint: str

    def rover_file(self, name: str) -> Path:
        """config/zenoh-rover.json5 with the certificates of this name."""
        return self._file("zenoh-rover.json5", "rover1", name)

    def tool_file(self, name: str) -> Path:
        """config/zenoh-operator.json5 with the certificates of this name; what an attacker would have too."""
        return self._file("zenoh-operator.json5", "operator", name)

    def _file(self, source: str, named: str, name: str) -> Path:
        text = (CONFIG / source).read_text().replace(f"/etc/infant/zenoh/{named}.", f"{self.certificates}/{name}.")
        path = self.certificates / f"{name}-{source}"
        path.write_text(text.replace("/etc/infant/zenoh", str(self.certificates)))
        return path

    def rover_settings(self, name: str, **changes: Any) -> PublishSettings:
        file = str(self.rover_file(name))
        return settings_on(0, **{"listen": (), "connect": (self.endpoint,), "config_file": file, **changes})

    def client(self, name: str) -> zenoh.Session:
        config = zenoh.Config.from_file(str(self.tool_file(name)))
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([self.endpoint]))
        return zenoh.open(config)


@contextmanager
def running_fleet(folder: Path) -> Iterator[Fleet]:
    """A router on a free port of this machine, with certificates of its own in the folder."""
    subprocess.run([CONFIG / "make-test-ca.sh", folder], check=True)
    subprocess.run([CONFIG / "make-test-ca.sh", folder / "strangers", "rover1"], check=True)
    with routing(Fleet(folder, f"tls/127.0.0.1:{free_port()}")) as fleet:
        yield fleet


@contextmanager
def routing(fleet: Fleet, name: str = "router") -> Iterator[Fleet]:
    """The router itself, with the certificate of this name."""
    text = (CONFIG / "zenoh-fleet.json5").read_text()
    text = text.replace("/etc/infant/zenoh/router.", f"{fleet.certificates}/{name}.")
    text = text.replace("/etc/infant/zenoh", str(fleet.certificates))
    path = fleet.certificates / f"{name}-fleet.json5"
    path.write_text(text.replace("tls/0.0.0.0:7447", fleet.endpoint))
    with zenoh.open(zenoh.Config.from_file(str(path))):
        yield fleet
