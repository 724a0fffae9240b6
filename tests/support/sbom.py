"""What an installation consists of, as CycloneDX 1.6: every pin of requirements.lock with the hashes of its files.

    python -m tests.support.sbom build/sbom.cdx.json

The same lock gives the same bytes: there is no time and no random number in it.
"""

import json
import sys
import tomllib
import uuid
from pathlib import Path
from typing import Any

from tests.support.locks import LOCKS, ROOT, Facts, Pin, pins_of, read_facts

SPACE = uuid.UUID("6ba7b811-9dad-11d1-80b4-00c04fd430c8")  # RFC 4122: names that are addresses
PURL = "pkg:pypi/{name}@{version}"


def bill(lock: str, project: dict[str, Any], facts: dict[str, Facts]) -> dict[str, Any]:
    """The bill of materials of a lock's text; project: the table of pyproject.toml; facts: names of files by hash."""
    components = [_component(pin, facts) for pin in pins_of(lock)]
    root = PURL.format(name=project["name"], version=project["version"])
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{uuid.uuid5(SPACE, json.dumps([root, components]))}",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": root,
                "name": project["name"],
                "version": project["version"],
                "purl": root,
                "licenses": [{"license": {"id": project["license"]}}],
            }
        },
        "components": components,
        "dependencies": [{"ref": root, "dependsOn": [component["bom-ref"] for component in components]}],
    }


def _component(pin: Pin, facts: dict[str, Facts]) -> dict[str, Any]:
    version = str(pin.requirement.specifier).removeprefix("==")
    purl = PURL.format(name=pin.requirement.name.lower().replace("_", "-"), version=version)
    names = facts.get(pin.key, {"files": {}})["files"]
    files = [
        {
            "type": "distribution",
            "url": names.get(digest, pin.requirement.name),
            "hashes": [{"alg": "SHA-256", "content": digest}],
        }
        for digest in sorted(pin.hashes)
    ]
    return {
        "type": "library",
        "bom-ref": f"{purl}#{pin.requirement.marker}" if pin.requirement.marker else purl,
        "name": pin.requirement.name,
        "version": version,
        "purl": purl,
        "externalReferences": files,
    }


def main(out: Path) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    out.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(bill(LOCKS[0].read_text(encoding="utf-8"), project, read_facts()), indent=1)
    out.write_text(text + "\n", encoding="utf-8")
    sys.stdout.write(f"{out}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
